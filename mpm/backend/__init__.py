"""The backend: Taichi, the thread that may use it, memory of fields, launches of kernels.

A name is imported where it is first used: folders of caches and files are found without loading Taichi.

Imports: errors, lazy_names."""

from typing import TYPE_CHECKING

from mpm.lazy_names import lazy_names

if TYPE_CHECKING:
    from mpm.backend.allocation import Group, allocating, free_later, later, put
    from mpm.backend.session import (
        PRECISIONS,
        check_owner,
        default_precision,
        init,
        is_concurrent,
        is_shared,
        is_vulkan,
        numerics,
        once,
        present_program,
        real_type,
        session_precision,
        thread_count,
        ti,
    )
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
