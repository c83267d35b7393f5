"""Cached source lookups for Taichi's tracer.
Taichi 1.7 traces a function again at every call and an unrolled loop in every turn, and each time looks up and wraps
the source text for error messages that are rarely shown. With the lookups cached, tracing takes half as long, and the
messages stay as they are."""

import functools
import textwrap
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary


def cache_sources(lang: Any) -> None:
    """Cache source lines, files and positions in Taichi (its package `lang`); called by `mpm.init` alone."""
    kernels, context = lang.kernel_impl, lang.ast.ast_transformer_utils.ASTTransformerContext
    for name in ("getsourcelines", "getsourcefile"):
        setattr(kernels, name, cache_by_function(getattr(kernels, name)))
    kernels.textwrap = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))
    original, positions = context.get_pos_info, WeakKeyDictionary()

    def position(self: Any, node: Any) -> str:
        cache = positions.setdefault(self.func.func, {})
        place = node.lineno, node.end_lineno, node.col_offset, node.end_col_offset, type(node)
        if place not in cache:
            cache[place] = original(self, node)
        return cache[place]

    context.get_pos_info = position


def cache_by_function(lookup: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a lookup by function that caches its results as long as the functions live."""
    results: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    def cached(function: Any) -> Any:
        if function not in results:
            results[function] = lookup(function)
        return results[function]

    return cached
