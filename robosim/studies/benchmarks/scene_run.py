"""One run of a scene at a setting, a job of a study: its readings, its cost and its parts."""

import math
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.backend import ti
from robosim.config.materials import MaterialConfig, load_material, overridden
from robosim.config.rehearsal import load_rehearsal
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import play
from robosim.planning.plan import plan_motion
from robosim.planning.recorded_motions import place_target
from robosim.rehearsal.metrics import compute_figures
from robosim.rehearsal.run import RehearsalRun
from robosim.studies.benchmarks.field_profile import FieldProfile
from robosim.studies.policies.script import ScriptedPolicy
from robosim.tasks.task import is_task, load_task

DOSED = ("poured", "spilled", "held")
"""Masses of a dosing task, whose shares of the load are read."""
FRACTIONS = ("delivered", "spilled", "retained", *DOSED)
"""Readings that are shares of the grains: their errors are differences, all others' are relative."""

PARTS = 5
"""Stretches of a sub-task's episode for which the field's cost is reported, of a rehearsal those between waypoints."""


class Part(NamedTuple):
    """A part of the field."""

    name: str
    present: bool
    """Whether it is compiled in."""
    reason: str
    """Why it is present or left out."""
    bytes: int = 0
    """Memory of its fields."""


def list_parts(solver: mpm.Solver) -> list[Part]:
    """List all parts of the field, present or left out."""
    f, p, g = solver.features, solver.particles, solver.fields.grid
    contact, s = solver.fields.static_contact, solver.fields.sleepers
    n = sum(p.counts)
    laws = ", ".join(sorted({type(b.material).__name__ for b in solver.bodies}))
    conditions = ", ".join(type(condition).__name__ for condition in solver.fields.wall_conditions)
    shapes = {i: type(c.sdf).__name__ for i, c in enumerate(solver.colliders)}

    def names(indices: tuple[int, ...]) -> str:
        return ", ".join(f"{i}: {shapes[i]}" for i in indices)

    return [
        Part("particles: position, velocity, affine velocity", True, f"{n} particles",
             field_bytes(p.x) + field_bytes(p.v) + field_bytes(p.C)),
        Part("particles: strain", f.tensor_state, laws if f.tensor_state else f"{laws}: the volume is enough",
             field_bytes(p.e)),
        Part("particles: volume ratio", f.volume_state, laws if f.volume_state else "no fluid", field_bytes([p.j])),
        Part("particles: volume correction", f.volume_correction,
             "sand that expanded" if f.volume_correction else f"{laws} has none", field_bytes([p.vc])),
        Part("particles: body acceleration", f.body_acceleration,
             "prescribed" if f.body_acceleration else "gravity only", field_bytes(p.acceleration or [])),
        Part("grid", True, f"{g.nodes.shape[0]} x {g.nodes.shape[1]} x {g.nodes.shape[2]} nodes of 16 bytes or more; "
             "only blocks with particles are visited", field_bytes([g.nodes])),
        Part("second layer of velocities", bool(f.shells), f"thin shells {names(f.shells)}" if f.shells
             else "no shell that separates two sides"),
        Part("contact cached at nodes", bool(f.static_colliders), names(f.static_colliders) or "no static collider",
             field_bytes([contact.plane, contact.owner] if contact else [])),
        Part("moving colliders", bool(f.moving_colliders), names(f.moving_colliders) or "no moving collider"),
        Part("mobile colliders", bool(f.mobile), f"{names(f.mobile)}: two-way coupling" if f.mobile
             else "all motions are prescribed; no wrench is compiled"),
        Part("wall conditions", bool(conditions), conditions or "all sides are periodic"),
        Part("periodic sides", any(f.periodic), "requested" if any(f.periodic) else "no side is periodic"),
        Part("strain by eigenvalues", f.integrator != "series", f"integrator {f.integrator}" if f.integrator != "series"
             else "the series is exact to the precision at these steps"),
        Part("strides of several substeps", f.strides, f"velocities stay on the grid for up to "
             f"{1e3 * solver.transfer_interval:.2g} ms" if f.strides else "every substep transfers to the particles"),
        Part("sleeping", f.sleep, f"{1.0 - solver.awake.mean():.0%} of the particles sleep at the end" if f.sleep
             else "every particle is computed", field_bytes([s.sums, s.path, s.window] if s else [])),
        Part("counter of the task", solver.counter is not None, "counts within the launch" if solver.counter is not None
             else "no counter is attached"),
        Part("adjoint", False, "no Rollout"),
        Part("double precision", f.precision == "f64", f"precision {f.precision}"),
    ]


def field_bytes(fields: list) -> int:
    """Return the bytes of taichi fields; None counts as 0."""
    return sum(math.prod((*field.shape, getattr(field, "n", 1), getattr(field, "m", 1)))
               * (8 if field.dtype in (ti.f64, ti.i64) else 4) for field in fields if field is not None)


class Stopwatch:
    """Times methods of objects; the time of a method called by another is subtracted from the outer one's."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        """Name -> wall time [s]."""
        self._inside: list[float] = []
        """Of each call that runs: wall time [s] of the calls within it."""

    def wrap(self, owner: Any, method: str, name: str, after: Callable[[float], None] = lambda seconds: None) -> None:
        """Wrap `owner.method`, so that its time is added to `seconds[name]`.
        after: called with each call's processor time [s]; no name's time contains its own."""
        inner = getattr(owner, method)

        def timed(*arguments: Any, **options: Any) -> Any:
            self._inside.append(0.0)
            begin, processor_begin = time.perf_counter(), time.process_time()
            try:
                return inner(*arguments, **options)
            finally:
                processor, taken = time.process_time() - processor_begin, time.perf_counter() - begin
                self.seconds[name] += taken - self._inside.pop()
                after(processor)
                if self._inside:
                    self._inside[-1] += time.perf_counter() - begin

        setattr(owner, method, timed)


def measure_scene(scene: str, setting: dict[str, float]) -> dict[str, Any]:
    """Run a sub-task or a rehearsal; return readings, seconds, simulated seconds, parts and costs.
    setting: factors on the scene's own "cell", "grains_per_cell", "E", "dt" of a sub-task, "host_dt" of a rehearsal."""
    mpm.init()
    return run_task(scene, setting) if is_task(scene) else run_rehearsal(scene, setting)


def make_result(solver: mpm.Solver, stopwatch: Stopwatch, seconds: float, simulated: float,
                readings: dict[str, float], profile: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the result of a run; costs are seconds per simulated second. profile: of the field, see there."""
    costs = {name: value / simulated for name, value in sorted(stopwatch.seconds.items(), key=lambda item: -item[1])}
    costs["everything else"] = (seconds - sum(stopwatch.seconds.values())) / simulated
    return {"readings": {k: float(v) for k, v in readings.items()}, "seconds": seconds, "simulated_s": simulated,
            "grains": sum(solver.particles.counts), "cell_m": solver.grid.cell, "dt_s": solver.dt, "costs": costs,
            "profile": profile, "parts": [part._asdict() for part in list_parts(solver)]}


def scaled_stiffness(material: MaterialConfig, setting: dict[str, float]) -> dict[str, float]:
    """Return {"E": Young's modulus [Pa]} scaled by a setting; nothing where it has no factor for it."""
    return {"E": getattr(material, "E").value * setting["E"]} if "E" in setting else {}  # noqa: B009  (not every law)


def run_task(name: str, setting: dict[str, float]) -> dict[str, Any]:
    """Run an episode of the scripted policy, without the arm."""
    task = load_task(name)
    dt = task.field.dt and task.step_dt / max(1, round(task.step_dt / (task.field.dt * setting.get("dt", 1.0))))
    field = task.field.model_copy(update={"cell": task.field.cell * setting.get("cell", 1.0), "dt": dt})
    numbers: dict[str, Any] = dict(scaled_stiffness(load_material(task.material), setting))
    env = GrainEnv(task=task.model_copy(update={"field": field}), **numbers)
    observation, _ = env.reset(options={"nominal": True})
    env.solver.compile()
    profile, stopwatch = FieldProfile(env.solver), Stopwatch()
    stopwatch.wrap(env.solver, "advance", "field", profile.record)
    stopwatch.wrap(env.reward, "step", "reward")
    stopwatch.wrap(env.world.observer, "read", "observation")
    policy, impulses, begin = ScriptedPolicy(env), [], time.perf_counter()
    _, info = play(env, policy, observation=observation,
                   hooks=[lambda step: impulses.append(np.linalg.norm(env.solver.ledger[2, :3]))])
    seconds = time.perf_counter() - begin
    force = float(np.mean(impulses)) / (env.action_repeat * task.step_dt)
    load = float(env.solver.masses().sum())  # the same number of grains weighs more on coarser cells
    readings = {k: info["readings"][k] for k in FRACTIONS[:3]} if task.dose is None else \
        {k: info["readings"][k] / load for k in DOSED}
    return make_result(env.solver, stopwatch, seconds, env.episode.time,
                       readings | {"tool_force_over_weight": force / (9.81 * load)},
                       profile.summarize({f"{k + 1} of {PARTS}": env.episode.time * k / PARTS for k in range(PARTS)}))


def run_rehearsal(name: str, setting: dict[str, float]) -> dict[str, Any]:
    """Run a rehearsal with the whole arm, without film."""
    config = place_target(load_rehearsal(name))
    cell = config.field.cell * setting.get("cell", 1.0)
    field = config.field.model_copy(update={"cell": cell, "grains_per_cell": config.field.grains_per_cell
                                            * setting.get("grains_per_cell", 1.0)})
    wall = "shell" if config.tool_wall == "shell" else float(np.clip(config.solid_wall, 0.5 * cell, cell))
    host_dt = config.host_dt * setting.get("host_dt", 1.0)
    config = config.model_copy(update={"field": field, "tool_wall": wall, "host_dt": host_dt})
    if "host_dt" in setting:
        type(config).model_validate(config.model_dump())  # raises for one that is not accepted
    material = load_material(config.material)
    material = overridden(material, scaled_stiffness(material, setting))
    run = RehearsalRun(plan_motion(config), material=material)
    run.solver.compile()
    profile, stopwatch = FieldProfile(run.solver), Stopwatch()
    stopwatch.wrap(run.solver, "advance", "field", profile.record)
    stopwatch.wrap(run.cell.plugin, "step", "coupling, with MuJoCo's step")
    stopwatch.wrap(run.cell.servo, "compute_torque", "servo")
    run.run(lambda: None)
    figures = compute_figures(run)
    names = {"scooped_mass_kg": "scooped_mass_kg", "wrist_payload_kg": "wrist_payload_kg",
             "delivered": "delivered_fraction", "spilled": "spilled_fraction", "dose_kg": "dose_kg"}
    lacking = {"dose_kg"} if config.dose is None else set()
    lacking |= {"wrist_payload_kg"} if config.weigh_at is None else set()  # a shovel does not weigh its load
    readings = {name: float(figures[key])  # pyright: ignore[reportArgumentType]
                for name, key in names.items() if name not in lacking}
    begins = {"before": 0.0} | {name: begin + config.grasp_time for name, begin in run.plan.path.times.items()}
    return make_result(run.solver, stopwatch, run.wall_time, run.time, readings, profile.summarize(begins))
