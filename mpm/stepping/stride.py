"""Strides: how many substeps velocities stay on the grid before particles take them up again.

Every transfer to the grid and back smooths velocities over a cell: a drag, the stronger the more transfers a second
has, and so the smaller the substep. But only the substep has to be as small as the speed of sound asks; particles may
stay where they are as long as they travel little. In a stride of several substeps, nodes keep their velocity and feel
stress, gravity and contact in every one, and particles take up the rate of strain alone.

A stride begins and ends with half a kick (velocity Verlet), so that velocity and stress are of one time where
velocities are transferred. What the substeps conserve then has no term with both, and a transfer, which shrinks
velocities, cannot make it larger: nothing at rest gains energy (docs/concepts/strides.md). Particles drift half of the
stride before it with the velocity that they bring to it, and half after it with the one that they take from it, so that
momentum and angular momentum are kept, and the path of free fall is exact."""

from mpm.backend import ti
from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import LINEAR
from mpm.materials.material import Material
from mpm.materials.stable_step import TRAVEL_FRACTION, lone_bound
from mpm.motion.mobile_motion import TWIST
from mpm.scene.scene import Interval, Scene
from mpm.state.packs import LANES, count_packs, pack_at
from mpm.state.particles import SPEED_LIMIT

TRAVEL = 0.375
"""Cells that a particle may travel in a stride: half of it, before contact sees the particle, is less than the quarter
of a cell by which one of two a cell stands off a wall."""
STRAINED, MANY, SHORT = 0.06, 0.2, 2.3
"""Entry of b - I; share of the particles; longest stride, in bounds, where more than that share have a larger entry.
The force of a stress that turns with the velocity gradient, at a place that stays, is not the derivative of an energy:
with 5 % of strain and twelve substeps a lateral vibration of an elastic block grows. A few particles do no harm."""
LONGEST = 9.0
"""Default length of a stride, in substeps at which a lone particle is stable: twelve of the default length, or seven of
a law that stiffens with density. A column's rim is then within
1.1 % of its reference at Courant numbers from 0.1 to 0.55, and there is one kick more for twelve."""


MAX_SUBSTEPS = 64
"""Substeps in one launch; a longer advance is cut, so that Ctrl-C and the finiteness check come in time."""


def choose_interval(interval: Interval, scene: Scene, materials: list[Material]) -> float:
    """Return the longest stride [s]: `interval`, or where that is None `LONGEST` bounds of a lone particle.
    None means a single substep, 0, in two cases. Transfers are all that damps a fluid's noise: the thrust on a gate
    falls by a tenth within two seconds otherwise. And where contact moves a collider, a host cuts time as it likes: a
    swing through sand must not depend on its steps, unless "strides" says that these are known and long. Raises
    InvalidValue for what is neither a time [s] nor "strides" nor None."""
    if interval is None and any(collider.mobile for collider in scene.colliders):
        return 0.0
    if interval is None or interval == "strides":
        return 0.0 if any(body.material.state == "volume" for body in scene.bodies) \
            else LONGEST * min(lone_bound(scene.grid.cell, law) for law in materials)
    if isinstance(interval, str) or not interval >= 0:
        raise InvalidValue(f"Solver: transfer_interval = {interval!r}; accepted: a time [s], 0, \"strides\" or None")
    return float(interval)


def split_launches(total: int, interval: int) -> list[tuple[int, int]]:
    """Return (first, number) of the substeps of every launch of an advance that is read every `interval` substeps.
    Strides end with a launch: so that they do not depend on what lies beyond a reading, launches end there, too."""
    if interval <= MAX_SUBSTEPS:
        size = MAX_SUBSTEPS // interval * interval
        return [(first, min(size, total - first)) for first in range(0, total, size)]
    return [(begin + first, min(MAX_SUBSTEPS, interval - first)) for begin in range(0, total, interval)
            for first in range(0, interval, MAX_SUBSTEPS)]


def longest_stride(interval: float, dt: float) -> int:
    """Return the substeps of dt [s] in the longest stride, of `interval` [s]."""
    return max(1, int(min(interval / dt + 1e-6, MAX_SUBSTEPS)))


@ti.func
def survey(fields: ti.template(), P: ti.template(), first, last):
    """Return the largest squared speed [m^2/s^2] of the packs at places first .. last - 1, and how many of their lanes
    are strained by more than STRAINED."""
    fastest = P.v[0][0][0] * 0.0
    strained = fastest
    for place in range(first, last):
        q = pack_at(fields, place)
        v2 = P.v[0][q] ** 2 + P.v[1][q] ** 2 + P.v[2][q] ** 2
        fastest = ti.max(fastest, v2.max())
        if ti.static(len(P.e) > 0):
            largest = 0.0 * v2
            for i in ti.static(range(6)):
                largest = ti.max(largest, ti.abs(P.e[i][q]))
            strained += ti.cast(largest > STRAINED, fields.real).sum()
    return ti.Vector([fastest, strained])


@ti.func
def limit_stride(fields: ti.template(), motion: ti.template(), s: ti.i32, mobile: ti.template(), dt, most: ti.i32,
                 found):
    """Return the substeps, 1 to `most`, of the stride that begins with row s of the motion table.
    At its present speed no particle travels more than `TRAVEL` cells, no collider more than it may in a substep. found:
    of all particles, see `survey`. Returns 0 where a particle is too fast for any: it may not drift."""
    fastest = found[0]
    count = within(most, dt * ti.sqrt(fastest), ti.static(TRAVEL * fields.cell))
    for row, index in ti.static(enumerate(fields.features.moving_colliders)):
        radius, limit = ti.static(fields.colliders[index].sdf.radius, TRAVEL_FRACTION * fields.cell)
        if ti.static(fields.mobile_place[index] >= 0):
            V = [mobile[fields.mobile_place[index], TWIST + i] for i in ti.static(range(6))]
            speed = ti.Vector(V[:3]).norm() + radius * ti.Vector(V[3:]).norm()
            count = within(count, ti.cast(dt, ti.f64) * speed, limit)
        else:
            for ahead in range(s, s + count):
                V = [motion[row, ahead, LINEAR + i] for i in ti.static(range(6))]
                count = within(count, dt * (ti.Vector(V[:3]).norm() + radius * ti.Vector(V[3:]).norm()), limit)
    if found[1] > ti.static(MANY * LANES) * count_packs(fields):
        bound = fields.cell / ti.sqrt(largest_ratio(fields.parameters))
        count = within(count, dt, SHORT * bound)
    if not dt * ti.sqrt(fastest) <= ti.static(SPEED_LIMIT * fields.cell):  # true for NaN
        count = 0
    return count


@ti.func
def largest_ratio(parameters: ti.template()):
    """Return the largest ratio of `moduli` and density of a body, (cell / bound)^2 of a lone particle [m^2/s^2]."""
    ratio = parameters.zero[None]
    for body in range(parameters.densities.shape[0]):
        ratio = ti.max(ratio, parameters.moduli[body] / parameters.densities[body])
    return ratio


@ti.func
def kick_of(dt, is_strained: ti.i32, left: ti.i32):
    """Return the time [s] for which nodes feel forces: half a substep of dt [s] at both ends of a stride.
    is_strained: 0 for the half with which a stride begins. left: substeps until the stride ends."""
    return ti.select(is_strained == 1 and left > 0, dt, 0.5 * dt)


@ti.func
def within(count: ti.i32, travel, limit):
    """Return count, or as many substeps of a travel or time each as stay within a limit; at least one."""
    result = 1
    if 2.0 * travel <= limit:  # false for NaN
        result = ti.min(count, ti.cast(limit / ti.max(travel, 1e-3 * limit), ti.i32))
    return ti.max(result, 1)
