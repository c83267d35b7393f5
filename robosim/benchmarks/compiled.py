"""What a solver compiles in and allocates for its scene, and what it leaves out and why."""

from typing import NamedTuple

import mpm
from mpm.backend import ti


class Part(NamedTuple):
    """Something that a scene may need."""

    name: str
    here: bool
    why: str
    bytes: int = 0


def parts(solver: mpm.Solver) -> list[Part]:
    """Every part of the field, there or not."""
    f, p, g = solver.features, solver.particles, solver.fields
    n = sum(p.counts)
    laws = ", ".join(sorted({type(b.material).__name__ for b in solver.bodies}))
    shapes = {i: type(c.sdf).__name__ for i, c in enumerate(solver.colliders)}

    def named(indices: tuple[int, ...]) -> str:
        return ", ".join(f"{i}: {shapes[i]}" for i in indices)

    return [
        Part("grains: place, velocity, affine velocity", True, f"{n} grains", size(p.x) + size(p.v) + size(p.C)),
        Part("grains: strain", f.tensor_state, laws if f.tensor_state else f"{laws}: volume is all that counts",
             size(p.e)),
        Part("grains: volume ratio", f.volume_state, laws if f.volume_state else "no fluid", size([p.j])),
        Part("grains: remembered expansion", f.volume_correction,
             "volume correction of sand" if f.volume_correction else f"{laws} remembers none", size([p.vc])),
        Part("grains: acceleration of their own", f.body_acceleration,
             "given" if f.body_acceleration else "gravity is all", size(p.acceleration or [])),
        Part("grid", True, f"{g.nodes.shape[0]} x {g.nodes.shape[1]} x {g.nodes.shape[2]} nodes of 16 bytes or more; "
             "only blocks with grains are visited", size([g.nodes])),
        Part("second layer of velocities", bool(f.shells), f"thin shells {named(f.shells)}" if f.shells
             else "no shell: grains are on one side of everything"),
        Part("contact cached at nodes", bool(f.static_colliders), named(f.static_colliders) or "nothing stands still",
             size([solver.node_contact, solver.node_owner])),
        Part("moving colliders", bool(f.moving_colliders), named(f.moving_colliders) or "nothing moves"),
        Part("motion solved with the grains", bool(f.mobile), f"{named(f.mobile)}: two-way coupling" if f.mobile
             else "tools go where they are told; no wrench is compiled"),
        Part("periodic sides", any(f.periodic), "asked for" if any(f.periodic) else "no side is periodic"),
        Part("strain by eigenvalues", f.integrator != "series", f"integrator {f.integrator}" if f.integrator != "series"
             else "the series is exact to the precision at these steps"),
        Part("strides of several substeps", f.strides, f"velocities stay on the grid for up to "
             f"{1e3 * solver.transfer_interval:.2g} ms" if f.strides else "every substep brings them to the grains"),
        Part("tally of the task", solver.tally is not None, "read within the launch" if solver.tally is not None
             else "nobody counts within the launch"),
        Part("adjoint", False, "nobody has asked for a Rollout"),
        Part("double precision", f.precision == "f64", f"precision {f.precision}"),
    ]


def size(fields: list) -> int:
    """Bytes of taichi fields; None counts nothing."""
    total = 0
    for field in fields:
        if field is not None:
            numbers = 1
            for extent in (*field.shape, *(getattr(field, "n", 1), getattr(field, "m", 1))):
                numbers *= extent
            total += numbers * (8 if field.dtype in (ti.f64, ti.i64) else 4)
    return total
