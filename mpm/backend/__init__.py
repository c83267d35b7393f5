"""The backend: Taichi, the thread that may use it, memory of fields, launches of kernels.

Imports: errors.
"""

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

__all__ = ["PRECISIONS", "Group", "allocating", "check_owner", "default_precision", "free_later", "init",
           "is_concurrent", "is_shared", "is_vulkan", "later", "numerics", "once", "present_program", "put",
           "real_type", "session_precision", "thread_count", "ti"]
