"""Kernels are traced in Python, each function anew wherever it is called and each node of an unrolled loop anew in
every turn, and Taichi 1.7 looks up and wraps the source text every time, for messages that are rarely shown. What was
looked up once is remembered here: tracing takes half as long, and its messages stay as they are."""

import functools
import textwrap
from types import SimpleNamespace
from typing import Any


def remember_sources(lang: Any) -> None:
    """Have Taichi (its package `lang`) remember source lines, files and positions; for `mpm.init` alone."""
    kernels, context = lang.kernel_impl, lang.ast.ast_transformer_utils.ASTTransformerContext
    kernels.getsourcelines = functools.cache(kernels.getsourcelines)
    kernels.getsourcefile = functools.cache(kernels.getsourcefile)
    kernels.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))
    looked_up, known = context.get_pos_info, {}

    def position(self: Any, node: Any) -> str:
        where = (self.file, self.func.func.__qualname__, node.lineno + self.lineno_offset, node.end_lineno,
                 node.col_offset, node.end_col_offset, type(node))
        if where not in known:
            known[where] = looked_up(self, node)
        return known[where]

    context.get_pos_info = position
