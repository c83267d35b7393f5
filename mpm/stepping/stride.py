"""How many substeps velocities stay on the grid before the grains take them up again.

Every transfer to the grains and back smooths velocities over a cell: a drag, the stronger the more transfers a second
has, and so the smaller the substep. But only the substep has to be as small as sound asks; grains may stay where they
are for as long as they travel little. In a stride of several substeps, nodes keep their velocity and feel stress,
gravity and contact at every one, and the grains take up the rate of strain alone.

Grains drift before the stride with the velocity that they bring to it, and after it with the one that they take from
it, so that momentum and angular momentum are kept as by a single substep, and so is the path of free fall.
"""

from typing import Literal

from mpm.backend import ti
from mpm.boundaries.mobile_contact import TWIST
from mpm.errors import InvalidValue
from mpm.materials.stable_step import TRAVEL_FRACTION
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.grid import BLOCK

Interval = float | Literal["strides"] | None
"""What may be asked of the longest stride (see `chosen_interval`)."""
TRAVEL = 0.5
"""Cells that a grain may travel in a stride."""
LONGEST = 3.0
"""Default length of a stride, in largest substeps: a column's rim is then within 1 % of its source at any Courant
number. Longer ones bring no more, and let its crest sag."""


MAX_SUBSTEPS = 64
"""Substeps in one launch; a longer advance is cut, so that Ctrl-C and the finiteness check come in time."""


def chosen_interval(asked: Interval, bodies: list[Body], colliders: list[Collider], bound: float) -> float:
    """Longest stride [s]: what is asked for, or else `LONGEST` times the bound [s]; a substep in two cases. Transfers
    are all that damps a fluid's noise (the thrust on a gate falls by a tenth within two seconds otherwise). And where
    contact moves a collider, a host cuts time as it likes: a swing through sand must not depend on its steps, unless
    "strides" says that these are known and long."""
    if asked is None and any(collider.mobile for collider in colliders):
        return 0.0
    if asked is None or asked == "strides":
        return 0.0 if any(body.material.state == "volume" for body in bodies) else LONGEST * bound
    if isinstance(asked, str) or not asked >= 0:
        raise InvalidValue(f"Solver: transfer_interval = {asked!r}; accepted: a time [s], 0, \"strides\" or None")
    return float(asked)


def launches(total: int, interval: int) -> list[tuple[int, int]]:
    """(first, number) of the substeps of every launch of an advance that is read after every `interval` substeps.

    Strides end with a launch: so that they do not depend on what lies beyond a reading, launches end there, too.
    """
    if interval <= MAX_SUBSTEPS:
        size = MAX_SUBSTEPS // interval * interval
        return [(first, min(size, total - first)) for first in range(0, total, size)]
    return [(begin + first, min(MAX_SUBSTEPS, interval - first)) for begin in range(0, total, interval)
            for first in range(0, interval, MAX_SUBSTEPS)]


def most_substeps(interval: float, dt: float) -> int:
    """Substeps of dt [s] in the longest stride, of `interval` [s]."""
    return max(1, int(min(interval / dt + 1e-6, MAX_SUBSTEPS)))


@ti.func
def stride(scene: ti.template(), motion: ti.template(), s: ti.i32, mobile: ti.template(), dt, most: ti.i32):
    """Substeps of the stride that begins with s, 1 to `most`: at its present speed no grain travels more than `TRAVEL`
    cells, no tool more than it may in a substep."""
    fastest = fastest_square(scene.particles, 0, scene.particles.pack_count[None])
    return stride_of(scene, motion, s, mobile, dt, most, fastest)


@ti.func
def fastest_square(particles: ti.template(), first, last):
    """Largest squared speed [m^2/s^2] of the packs first .. last - 1."""
    fastest = particles.v[0][0][0] * 0.0
    for q in range(first, last):
        v2 = particles.v[0][q] ** 2 + particles.v[1][q] ** 2 + particles.v[2][q] ** 2
        fastest = ti.max(fastest, v2.max())
    return fastest


@ti.func
def stride_of(scene: ti.template(), motion: ti.template(), s: ti.i32, mobile: ti.template(), dt, most: ti.i32, fastest):
    """`stride` where the grains' largest squared speed is known."""
    count = within(most, dt * ti.sqrt(fastest), ti.static(TRAVEL * scene.cell))
    for row, index in ti.static(enumerate(scene.features.moving_colliders)):
        radius, limit = ti.static(scene.colliders[index].sdf.radius, TRAVEL_FRACTION * scene.cell)
        if ti.static(scene.mobile_place[index] >= 0):
            V = [mobile[scene.mobile_place[index], TWIST + i] for i in ti.static(range(6))]
            speed = ti.Vector(V[:3]).norm() + radius * ti.Vector(V[3:]).norm()
            count = within(count, ti.cast(dt, ti.f64) * speed, limit)
        else:
            for ahead in range(s, s + count):
                V = [motion[row, ahead, 12 + i] for i in ti.static(range(6))]
                count = within(count, dt * (ti.Vector(V[:3]).norm() + radius * ti.Vector(V[3:]).norm()), limit)
    return count


@ti.func
def within(count: ti.i32, travel, limit):
    """Count, or fewer substeps of so much travel [m], so that they stay within a limit [m]; one at least."""
    result = 1
    if 2.0 * travel <= limit:  # not where it is no number
        result = ti.min(count, ti.cast(limit / ti.max(travel, 1e-3 * limit), ti.i32))
    return ti.max(result, 1)


@ti.func
def drift_before(dt, span: ti.i32):
    """Time [s] that grains drift before a stride: nothing before a single substep."""
    return 0.5 * dt * (span - 1)


@ti.func
def drift_after(dt, span: ti.i32):
    """Time [s] that grains drift after a stride; 0 for span 0, within one."""
    return 0.5 * dt * (span + (span > 0))


@ti.func
def hold(grid: ti.template(), first, last):
    """Turn the velocities of the substep before back to momenta, in the active blocks first .. last - 1."""
    for n in range(first, last):
        block = grid.active[n] * BLOCK
        for a, b in ti.ndrange(BLOCK, BLOCK):
            for c in ti.static(range(BLOCK)):
                I = block + ti.Vector([a, b, c])
                q = grid.nodes[I]
                grid.nodes[I] = ti.Vector([q[3] * q[0], q[3] * q[1], q[3] * q[2], q[3]])
