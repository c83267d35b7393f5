"""Fields that contact needs: static colliders, shells and their holes, nodes and particles at colliders that move.
A phase fills a list in its order with one thread; several take places from a counter. Threads of a CPU do so in any
order, but each in the order of its own part: sorted by part, a list is the same in every run. On a GPU lists whose
order matters, because each entry changes what the next one meets, are ranked by particle."""

from collections.abc import Mapping, Sequence

import numpy as np

from mpm.backend import is_concurrent, put, real_type, ti
from mpm.scene.collider import Collider, normals_at
from mpm.scene.features import Features
from mpm.scene.grid import BLOCK, Grid
from mpm.scene.validation import read_array
from mpm.state.packs import LANES, Packs

TOLERANCE = {"f32": 1e-5, "f64": 1e-11}
"""Error at which a contact solve ends, relative to the change of twist by contact."""

ALWAYS = 1e30  # volume [m^3] of an avalanche that never ends


class StaticContact:
    """The colliders that never move, looked up once at every node."""

    def __init__(self, grid: Grid, precision: str) -> None:
        self.plane = ti.Vector.field(4, real_type(precision), grid.shape)
        """Normal and signed distance [m] of the collider that owns the node."""
        self.owner = ti.field(ti.i32, grid.shape)
        """Index plus one of the collider whose contact the node takes; 0: none."""
        self.owned = ti.field(ti.i32, tuple(n // BLOCK for n in grid.shape))  # 1 where a node of the block has an owner


class ShellFields:
    """Sides of nodes, and the list of the particles with a side, in the order of the packs."""

    def __init__(self, grid: Grid, precision: str, n_particles: int, lists_entering: bool) -> None:
        real = real_type(precision)
        self.lists_entering = lists_entering
        self.side = ti.field(ti.i32, grid.shape)
        """Plus or minus the closest shell's collider index plus one, by side; 0 beyond its rim and far from any."""
        self.shell = ti.field(ti.i32, grid.shape)
        """The closest shell's collider index plus one, beyond the rim too; 0 far from any."""
        self.gap = ti.Vector.field(4, real, grid.shape)  # normal towards the positive side and signed distance [m]
        self.labelled = ti.field(ti.i32, tuple(n // BLOCK for n in grid.shape))  # whether a block's nodes hold labels
        self.count = ti.field(ti.i32, ())  # particles on the list
        self.slot = ti.Vector.field(2, ti.i32, n_particles)  # pack and lane
        self.place = ti.Vector.field(LANES, ti.i32, n_particles // LANES)
        """Place of each lane of a pack on the list, where it has a side."""
        self.base = ti.Vector.field(3, ti.i32, n_particles)  # first node of the stencil
        self.offset = ti.Vector.field(3, real, n_particles)  # offset from it in cells
        self.mass = ti.field(real, n_particles)  # [kg]
        self.q = [ti.Vector.field(4, real, n_particles) for _ in range(4)]
        """Momentum and mass, and the columns of the affine momentum per cell."""
        self.entering = ti.field(ti.i32, n_particles if lists_entering else 1)
        """Places on the list of the particles that would enter a shell, where a GPU lists them for one thread."""
        self.entering_order = ti.field(ti.i32, n_particles if lists_entering else 1)  # the same by particle
        self.entering_count = ti.field(ti.i32, ())
        self.entered = ti.Vector.field(4, real, n_particles)
        """Normal (3,) out of the shell that a particle's next move would take it into, and how deep [m]; or zeros."""

    def fill(self) -> None:
        """Forget all labels."""
        for field in (self.side, self.shell, self.labelled):
            field.fill(0)


class OrificeFields:
    """Small holes of shells: their places, the numbers of their law, and the state of each."""

    name = "orifices"  # name of the state in a snapshot of a solver

    def __init__(self, features: Features) -> None:
        real = real_type(features.precision)
        self._dtype = np.float64 if features.precision == "f64" else np.float32
        self.holes = sum(n for _, n in features.orifices)
        self.position, self.axis = (ti.Vector.field(3, real, self.holes) for _ in range(2))
        """Centre [m] and direction outward, in the shell's frame."""
        self.numbers = ti.field(real, (self.holes, 6))
        """Diameter D, effective diameter D - k d [m], C, bulk volume [m^3] of an avalanche, threshold of vibration, and
        the sign of the shell's outer side."""
        self.state = ti.Vector.field(LANES, ti.f64, 2 * self.holes)
        """Two packs a hole. First: the shell's velocity there [m/s], smoothed, and the mass due [kg]. Second: square of
        its acceleration [m^2/s^4], smoothed, or -1 before the first stride; mass of the present avalanche, mass passed
        in all [kg], and speed [m/s] at which the face about the hole recedes."""
        self.packs = ti.field(ti.i32, ())  # packs of `state`
        put(self.packs, np.array(2 * self.holes, np.int32))
        self._states = Packs([self.state], self.packs, np.float64)

    def fill(self, colliders: Sequence[Collider]) -> None:
        """Write the numbers of a scene's holes, which have let nothing through."""
        holes = [(c.sdf, o) for c in colliders for o in c.orifices]
        put(self.position, np.concatenate([o.positions for _, o in holes]).astype(self._dtype))
        put(self.axis, np.concatenate([o.axes for _, o in holes]).astype(self._dtype))
        rows = []
        for shell, o in holes:
            outer = np.sign(np.einsum("nd,nd->n", normals_at(shell, o), o.axes))
            law = (o.diameter, o.opening, o.C, min(o.avalanche, ALWAYS), o.vibration)
            rows += [(*law, sign) for sign in outer]
        put(self.numbers, np.array(rows, self._dtype))
        start = np.zeros((1, self.holes, 2 * LANES))
        start[..., LANES] = -1.0
        self.write(start.reshape(1, -1, LANES))

    def read(self) -> np.ndarray:
        """Return the state of the holes (holes, 8)."""
        return self._states.read([self.state]).reshape(self.holes, 2 * LANES)

    def read_snapshot(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the holes' state in a snapshot as packs (1, 2 holes, LANES); raises InvalidValue for another scene."""
        return read_array(state, "orifices", (self.holes, 2 * LANES)).astype(float).reshape(1, -1, LANES)

    def write(self, packs: np.ndarray) -> None:
        """Write the state of the holes, as packs (1, 2 holes, LANES)."""
        self._states.write([self.state], packs)


class PenetratingParticles:
    """Particles near moving solids, listed by several threads for one to stop them; room for `capacity`."""

    def __init__(self, capacity: int, parts: int) -> None:
        self.count = ti.field(ti.i32, ())
        self.particle = ti.Vector.field(4, ti.i32, capacity)  # number of the moving solid, body, pack and lane
        self.part = ti.field(ti.i32, capacity)
        """Part of the packs that it is in; on a GPU, a number that says which comes first."""
        self.order, self.begins = ti.field(ti.i32, capacity), ti.field(ti.i32, parts + 1)  # see `sort_by_part`


class MobileContact:
    """The nodes that each mobile collider touches in this substep, and room for six equations.
    parts: parts of several threads of a CPU; 0: the lists need no sorting. recedes: a collider has orifices."""

    def __init__(self, capacities: list[int], precision: str, parts: int = 0, recedes: bool = False) -> None:
        real = real_type(precision)
        self.tolerance = TOLERANCE[precision]
        ends = np.cumsum(capacities)
        self.first = [int(end - n) for end, n in zip(ends, capacities)]  # first place of each collider in the lists
        self.count = ti.field(ti.i32, len(capacities))  # nodes on each collider's list
        self.sorts = parts > 0  # whether the lists are sorted by part before they are used
        sorted_room = int(ends[-1]) if self.sorts else 1
        self.part, self.order = ti.field(ti.i32, sorted_room), ti.field(ti.i32, sorted_room)
        self.begins = ti.field(ti.i32, parts + 1)  # see `sort_by_part`
        self.node = ti.Vector.field(3, ti.i32, int(ends[-1]))
        self.normal = ti.Vector.field(3, real, int(ends[-1]))  # out of the collider, in world axes
        self.recedes = recedes
        self.receding = ti.Vector.field(3, real, int(ends[-1]) if recedes else 1)
        """Velocity [m/s] of the face besides that of the collider, at an orifice that flows."""
        self.slope = ti.field(ti.f64, (6, 6))  # derivative of the impulse on the nodes by the collider's twist
        self.impulse = ti.field(ti.f64, 6)  # what a team of threads sums up: impulse and torque
        self.system = ti.field(ti.f64, (6, 7))  # Newton's equations, the right-hand side in the last column


@ti.func
def take_place(counts: ti.template(), index: ti.template()):
    """Return the next free place of the list whose length is counts[index]."""
    place = 0
    if ti.static(is_concurrent()):
        place = ti.atomic_add(counts[index], 1)
    else:
        place = counts[index]
        counts[index] = place + 1
    return place


@ti.func
def rank_of(keys: ti.template(), place, count):
    """Return how many of the keys 0 .. count - 1 are smaller than that of a place."""
    rank, key = 0, keys[place]
    for other in range(count):
        if keys[other] < key:
            rank += 1
    return rank


@ti.func
def sort_by_part(order: ti.template(), part: ti.template(), begins: ti.template(), first, count):
    """Write the places first .. first + count - 1 of a list to `order` from `first` on, part by part.
    part: of each place, of which those of one part are in order. begins (parts + 1,): for its own use."""
    for p in range(begins.shape[0]):
        begins[p] = 0
    for n in range(first, first + count):
        begins[part[n] + 1] = begins[part[n] + 1] + 1
    for p in range(1, begins.shape[0]):
        begins[p] = begins[p] + begins[p - 1]
    for n in range(first, first + count):
        place = first + begins[part[n]]
        begins[part[n]] = begins[part[n]] + 1
        order[place] = n
