"""Gymnasium environments of the paper's eight sub-tasks; `import robosim` registers them."""

from functools import partial
from typing import Any

import gymnasium

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove")


def register() -> None:
    """Make the ids robosim/<task>-v0 known; nothing is imported or built before `gymnasium.make`."""
    for name in TASKS:
        gymnasium.register(f"robosim/{name}-v0", entry_point=f"robosim.envs.sub_tasks:{name}",
                           vector_entry_point=partial(_vector, name))


def _vector(name: str, **options: Any) -> gymnasium.vector.VectorEnv:
    """Several environments of one sub-task."""
    from robosim.envs.vector import make_vector

    return make_vector(name, **options)
