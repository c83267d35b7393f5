"""Cases of rehearsals: the plans of all bundled ones, the begin of their simulation, and short ones to the end."""

from typing import Any

from groups import case_of
from internals import is_wall_time, keep_plan, rounded, run_begin
from keep import Keep

import robosim


def begin(keep: Keep, name: str, steps: int = 150, **changes: Any) -> None:
    """Plan a bundled rehearsal with some changes, and simulate its first steps."""
    plan = robosim.Rehearsal(name, **changes).plan()
    keep_plan(keep, plan)
    if steps:
        run_begin(keep, plan, steps)


def run(keep: Keep, name: str, changes: dict[str, Any], **options: Any) -> None:
    """Run a bundled rehearsal with large cells and other values to its end, and keep what is reported of it."""
    data = robosim.Rehearsal(name).config.model_dump()
    data["field"] |= {"cell": 0.01, "grains_per_cell": 4}
    result = robosim.Rehearsal(robosim.RehearsalConfig.model_validate(data | changes)).run(**options)
    figures = {name: value for name, value in result.figures.items() if not is_wall_time(name)}
    keep("figures", {name: rounded(value) if name.endswith("clearance_m") and value is not None else value
                     for name, value in figures.items()})
    keep("missed", [line for line in result.missed if not is_wall_time(line)])
    keep("curves", result.curves)
    keep("positions", result.positions)


def dip(keep: Keep, **options: Any) -> None:
    """The spoon dips into its container and comes up again."""
    waypoints = {one["name"]: one for one in robosim.Rehearsal("spoon").config.model_dump()["waypoints"]}
    for name in ("start", "home"):
        waypoints[name]["position"] = (-0.03, 0.0, 0.12)
    down = waypoints["above"] | {"name": "dip", "position": (-0.03, 0.0, 0.06), "speed": 0.3, "stop": True,
                                 "dwell": 0.2}
    run(keep, "spoon", {"waypoints": [waypoints["start"], down, waypoints["home"]], "weigh_at": "dip",
                        "grasp_time": 0.2, "tool_wall": 0.005}, **options)


def dose(keep: Keep) -> None:
    """The spoon doses a little after a way of 2 cm."""
    config = robosim.Rehearsal("dose_spoon").config.model_dump()
    held, _, over, _, home = config["waypoints"]
    for waypoint in (held, home):
        waypoint |= {"position": (0.72, 0.165, 0.165), "dwell": 0.2, "speed": 0.1, "acceleration": 1.0}
    over |= {"dwell": 0.0, "speed": 0.1, "acceleration": 1.0}
    run(keep, "dose_spoon", {"waypoints": [held, over, home], "grasp_time": 0.05, "least_load": 0.0,
                             "dose": config["dose"] | {"settle": 0.2, "time_limit": 1.0}})


CASES = [
    *(case_of(f"rehearsal/{name}", begin, name, more="f64") for name in ("spoon", "dose_bottle")),
    *(case_of(f"rehearsal/{name}", begin, name, usual="f32") for name in ("spoon", "pick_bottle", "dose_spoon")),
    case_of("rehearsal/dip", dip, usual="f32"),
    case_of("rehearsal/dip", dip, model_errors=3, seed=1, more="f64"),
    *(case_of(f"rehearsal/{name}", begin, name, more="f32") for name in ("scoop", "shovel", "bottle", "dose_bottle")),
    case_of("rehearsal/dose", dose, more="f32"),
    *(case_of(f"rehearsal/{name}", begin, "shovel", coupling=name, more="f32") for name in ("lagged", "one_way")),
    *(case_of(f"plan/learned {name}", begin, name, 0, trajectory="learned", more="f32")
      for name in ("spoon", "scoop", "bottle", "shovel")),
    *(case_of(f"plan/{name}", begin, "spoon", 0, robot=name, more="f32") for name in ("ur5e", "panda", "xarm7")),
]
