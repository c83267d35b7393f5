"""Gymnasium environments of the paper's eight sub-tasks; `import robosim` registers them."""

import gymnasium

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove")


def register() -> None:
    """Make the ids robosim/<task>-v0 known; nothing is imported or built before `gymnasium.make`."""
    for name in TASKS:
        gymnasium.register(f"robosim/{name}-v0", entry_point=f"robosim.envs.sub_tasks:{name}")
