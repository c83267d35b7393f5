"""Cached source lookups for Taichi's tracer.
Taichi 1.7 traces a function again at every call and an unrolled loop in every turn, and each time looks up and wraps
the source text for error messages that are rarely shown. With the lookups cached, tracing takes half as long, and the
messages stay as they are."""

import functools
import sys
import textwrap
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary


def skip_source_lookups(kernels: Any) -> None:
    """Let a decorator of Taichi (its module `kernel_impl`) see by the names that Python gives to a class's body whether
    it stands in one, not by the source text around each use: a quarter of the time that robosim takes to import."""

    def is_in_class(level_of_class_stackframe: int) -> bool:
        names = sys._getframe(level_of_class_stackframe - 1).f_locals
        return "__module__" in names and "__qualname__" in names

    kernels._inside_class = is_in_class


def cache_sources(lang: Any) -> None:
    """Cache source lines, files and positions in Taichi (its package `lang`); called by `mpm.init` alone."""
    kernels, context = lang.kernel_impl, lang.ast.ast_transformer_utils.ASTTransformerContext
    for name in ("getsourcelines", "getsourcefile"):
        setattr(kernels, name, cache_by_function(getattr(kernels, name)))
    kernels.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))
    original = context.get_pos_info

    def position(self: Any, node: Any) -> str:
        if sys.exc_info()[0] is not None:  # for a message
            return original(self, node)
        return f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}:\n'

    context.get_pos_info = position
    reuse_trees(kernels)


def reuse_trees(kernels: Any) -> None:
    """Parse the text of a function once; it is parsed again only where it is traced within itself."""
    trees: dict[str, list[Any]] = {}
    parse, transform = kernels.ast.parse, kernels.transform_tree

    def take(text: str) -> Any:
        free = trees.setdefault(text, [])
        return free.pop() if free else parse(text)

    def transform_and_free(tree: Any, ctx: Any) -> Any:
        result = transform(tree, ctx)
        if not ctx.is_kernel:  # whose tree loses its arguments
            trees[kernels.textwrap.dedent("\n".join(ctx.src))].append(tree)
        return result

    kernels.ast, kernels.transform_tree = SimpleNamespace(parse=take), transform_and_free


def cache_by_function(lookup: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a lookup by function that caches its results as long as the functions live."""
    results: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    def cached(function: Any) -> Any:
        if function not in results:
            results[function] = lookup(function)
        return results[function]

    return cached
