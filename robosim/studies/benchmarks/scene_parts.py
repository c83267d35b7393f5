"""Parts of a scene: what a solver compiles and allocates for it, with the reason, and the seconds that parts take."""

import math
import time
from collections import defaultdict
from typing import Any, NamedTuple

import mpm
from mpm.backend import ti


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
        self._inside: list[list[Any]] = []

    def wrap(self, owner: Any, method: str, name: str) -> None:
        """Wrap `owner.method`, so that its time is added to `seconds[name]`."""
        inner = getattr(owner, method)

        def timed(*arguments: Any, **options: Any) -> Any:
            frame = [name, 0.0]
            self._inside.append(frame)
            begin = time.perf_counter()
            try:
                return inner(*arguments, **options)
            finally:
                taken = time.perf_counter() - begin
                self._inside.pop()
                self.seconds[name] += taken - frame[1]
                if self._inside:
                    self._inside[-1][1] += taken

        setattr(owner, method, timed)
