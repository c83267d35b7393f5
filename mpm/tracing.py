"""Kernels are traced in Python, each function anew wherever it is called and each node of an unrolled loop anew in
every turn, and Taichi 1.7 looks up and wraps the source text every time, for messages that are rarely shown. What was
looked up once is remembered here: tracing takes half as long, and its messages stay as they are."""

import functools
import textwrap
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary


def remember_sources(lang: Any) -> None:
    """Have Taichi (its package `lang`) remember source lines, files and positions; for `mpm.init` alone."""
    kernels, context = lang.kernel_impl, lang.ast.ast_transformer_utils.ASTTransformerContext
    for name in ("getsourcelines", "getsourcefile"):
        setattr(kernels, name, remembered(getattr(kernels, name)))
    kernels.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))
    looked_up, known = context.get_pos_info, WeakKeyDictionary()

    def position(self: Any, node: Any) -> str:
        places = known.setdefault(self.func.func, {})
        where = node.lineno, node.end_lineno, node.col_offset, node.end_col_offset, type(node)
        if where not in places:
            places[where] = looked_up(self, node)
        return places[where]

    context.get_pos_info = position


def remembered(look_up: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A look-up by function that keeps what it found as long as the function lives."""
    known: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    def found(function: Any) -> Any:
        if function not in known:
            known[function] = look_up(function)
        return known[function]

    return found
