"""Suites: the starts and materials that policies are scored from, the same for all of them.

nominal: the task's own material and random starts. wide: target and container displaced, tool displaced and turned,
more or fewer grams, another material and another friction of the tool. materials: the task's own random starts in
thirteen materials.
"""

from typing import Any, NamedTuple

import numpy as np

from robosim.envs.grain_env import GrainEnv
from robosim.errors import UnknownName
from robosim.evaluation import SUITES
from robosim.evaluation.material_episode import MATERIALS
from robosim.tasks.counting import TOOL
from robosim.tasks.task import TaskConfig

HELD_OUT = 1_000_000
"""Seed of the first episode of a suite; training draws its seeds from all 32-bit numbers, so that one in four thousand
million is one of these."""
SHIFT, TURN = 0.03, 20.0
"""Largest displacement [m] along each axis and turn [deg] of the tool at the start, in the suite "wide"; that of target
and container on the table is as large."""
FILLS = (0.8, 1.0, 1.2)
"""Mass of the grains there, in that of the task; their number, which a policy may observe, stays the same."""
FRICTIONS = (0.05, 0.3)
"""Least and largest friction of the tool there."""
WIDE_MATERIALS = ("salt", "sugar", "sand", "flour")
"""Materials there, in turn."""


class Start(NamedTuple):
    """How one episode of a suite begins."""

    seed: int
    material: str
    numbers: dict[str, float]
    """Of the material, in place of its own."""
    label: str
    """Name of the material with these numbers."""
    fill: float = 1.0
    """Mass of the grains in that of the task."""
    place: tuple[float, float] = (0.0, 0.0)
    """Displacement [m] on the table of target and container, which a policy sees as far as its observation has it."""
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Displacement of the tool [m]."""
    turn_deg: float = 0.0
    """Turn of the tool about the vertical."""
    friction: float | None = None
    """Of the tool; None: the task's own."""

    @property
    def world(self) -> tuple[Any, ...]:
        """What starts share that one environment can make."""
        return self.material, tuple(self.numbers.items()), self.fill, self.place

    def describe(self) -> dict[str, Any]:
        """Return what a row of results says of it."""
        x, y, z = self.shift
        return {"seed": self.seed, "material": self.label, "fill": self.fill, "place_x_m": self.place[0],
                "place_y_m": self.place[1], "shift_x_m": x, "shift_y_m": y, "shift_z_m": z, "turn_deg": self.turn_deg,
                "tool_friction": self.friction}


def plan_starts(suite: str, task: TaskConfig, episodes: int, material: str | None = None) -> list[Start]:
    """Return the starts of a suite, the same for every policy.

    material: in place of the task's own, in the suite "nominal". A shorter suite is the beginning of a longer one.
    Raises UnknownName for a suite that does not exist.
    """
    if suite not in SUITES:
        raise UnknownName("suite", suite, SUITES)
    own = material or task.material
    labels, starts = list(MATERIALS), []
    for k in range(episodes):
        seed = HELD_OUT + k
        if suite == "nominal":
            starts.append(Start(seed, own, {}, own))
        elif suite == "materials":
            label = labels[k % len(labels)]
            starts.append(Start(seed, *MATERIALS[label], label))
        else:
            rng = np.random.default_rng(seed)
            name = WIDE_MATERIALS[k % len(WIDE_MATERIALS)]
            # Another place needs another field, as another material or fill does: one place for each pair of these.
            world = k % (len(WIDE_MATERIALS) * len(FILLS))
            to_x, to_y = np.random.default_rng(HELD_OUT - 1 - world).uniform(-SHIFT, SHIFT, 2)
            x, y, z = rng.uniform(-SHIFT, SHIFT, 3)
            fill = FILLS[world // len(WIDE_MATERIALS)]
            starts.append(Start(seed, name, {}, name, fill, (to_x, to_y), (x, y, z), rng.uniform(-TURN, TURN),
                                rng.uniform(*FRICTIONS)))
    return starts


def displaced(task: TaskConfig, place: tuple[float, float]) -> TaskConfig:
    """Return a task with its container, target, goal and bounds displaced on the table."""
    def move(point: Any) -> tuple[float, float, float]:
        return point[0] + place[0], point[1] + place[1], point[2]

    container = task.container_place
    return task.model_copy(update={
        "goal": move(task.goal),
        **{name: region.model_copy(update={"centre": move(region.centre)})
           for name, region in (("target", task.target), ("bounds", task.bounds))},
        "container_place": container and container.model_copy(update={"position": move(container.position)})})


def make_environment(task: TaskConfig, start: Start, **options: Any) -> GrainEnv:
    """Make the environment that episodes with a start's material, fill and place run in."""
    task = displaced(task, start.place)
    field = task.field.model_copy(update={"grains_per_cell": task.field.grains_per_cell / start.fill})
    return GrainEnv(task=task.model_copy(update={"field": field}), material=start.material, **start.numbers, **options)


def begin_episode(env: GrainEnv, start: Start) -> None:
    """Reset the environment to a start."""
    env.solver.set_friction(TOOL, env.task.field.tool_friction if start.friction is None else start.friction)
    wide = start.shift != (0.0, 0.0, 0.0) or start.turn_deg != 0.0
    env.reset(seed=start.seed, options={"nominal": wide, "shift": start.shift, "turn_deg": start.turn_deg})
