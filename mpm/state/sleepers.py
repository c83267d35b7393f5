"""Sleeping particles, and the force and mass that they give to the nodes they share with particles awake."""

import numpy as np

from mpm.backend import put, real_type, ti
from mpm.scene.grid import BLOCK
from mpm.state.nodes import GridFields, first_nodes
from mpm.state.packs import LANES

ALL_LANES = 2**LANES - 1  # the bits of a pack all of whose lanes sleep
AHEAD = 1.0
"""Cells that particles stay awake ahead of contact with a moving collider: what it presses on gives way far around."""
CALM_TIME, CREEP, STRAIN, WAKE_DISPLACEMENT, CHECK_INTERVAL, FORCE, MASS, SUPPORT = range(8)
"""Places in `Sleepers.limits`."""


class Sleepers:
    """Fields that only a scene with sleeping has.
    A particle sleeps once its `rest` reaches the calm time; the fields here follow from that."""

    def __init__(self, grid: GridFields, n_packs: int, n_bodies: int, precision: str) -> None:
        self._dtype = np.float64 if precision == "f64" else np.float32
        self.calm_time = np.inf  # time [s] for which a particle is calm before it sleeps, as the particles hold it
        self.lanes_asleep = ti.field(ti.i32, n_packs)
        """Lanes of each pack that sleep, a bit each; padding lanes always do."""
        self.lanes_summed = ti.field(ti.i32, n_packs)  # lanes whose contributions are in `sums`, a bit each
        self.awake = ti.field(ti.i32, n_packs)  # packs with a lane that is awake, in order
        self.ranges = ti.Vector.field(2, ti.i32, n_bodies)  # first and last + 1 place of each body's packs in `awake`
        self.count = ti.field(ti.i32, ())  # number of packs in `awake`
        nodes = (grid.width, *grid.nodes.shape[1:])
        blocks = tuple(n // BLOCK for n in nodes)
        self.sums = ti.Vector.field(4, ti.i64, nodes)
        """Internal force and mass that sleepers give to each node, in whole quanta `limits[FORCE]` and `limits[MASS]`:
        sums of integers do not depend on their order, and what is taken away leaves nothing behind."""
        self.contribution = ti.Vector.field(4, real_type(precision), nodes)
        """The same as force [N] and mass [kg], which phases read."""
        self.changed = ti.field(ti.i32, blocks)  # 1 where `contribution` is not up to date with `sums`
        self.changed_blocks = ti.Vector.field(3, ti.i32, int(np.prod(blocks)))  # the blocks where it is 1
        self.changed_count = ti.field(ti.i32, ())  # how many these are
        self.stencil_count = ti.field(ti.i32, blocks)  # how many sleepers' stencils reach each block
        self.near = ti.field(ti.i32, blocks)
        """Number of the last search that found a moving collider in reach of the block."""
        self.search = ti.field(ti.i32, ())
        """Number of the last search for blocks in reach of colliders; a check at the end of a launch makes none."""
        self.home = ti.Vector.field(LANES, ti.i32, n_packs)
        """Place in `disturbed_at` of the node that each lane's stencil begins with, where the lane sleeps."""
        self.disturbed_at = ti.field(ti.i32, int(np.prod(nodes)))
        """Number of the last sleep check before which stencils that begin with a node may have been disturbed."""
        self.path = ti.Vector.field(3, real_type(precision), nodes)
        """Displacement [m] of each node since the last sleep check."""
        self.window = ti.field(ti.i32, nodes)  # sleep check since which `path` counts
        self.check = ti.field(ti.i32, ())  # number of the last sleep check
        self.is_disturbed = ti.field(ti.i32, ())
        """1 where a block is near a collider or a node has moved since the last sleep check."""
        self.version = ti.field(ti.i32, n_packs)
        """Changes whenever a pack may have become another since it slept: it woke, or its state was written."""
        self.are_sums_stale = ti.field(ti.i32, ())
        """1 where `sums` lack the contributions of sleepers, until the next sleep check."""
        self.limits = ti.field(ti.f64, 8)
        """Calm time [s], creep threshold [m], strain, wake displacement [m] of a sleeper's nodes, time [s] between two
        sleep checks; quanta of force [N] and mass [kg]; acceleration [m/s^2] up to which sleepers support nodes."""

    def set_limits(self, limits: np.ndarray) -> None:
        """Write `limits` (8,)."""
        self.calm_time = float(np.asarray(limits[CALM_TIME], self._dtype))
        put(self.limits, np.asarray(limits, np.float64))


@ti.func
def place_of_node(fields: ti.template(), node):
    """Return the place of a node (3,) in a field of all nodes of the first layer."""
    shape = ti.static(fields.sleepers.path.shape)
    return (node[0] * shape[1] + node[1]) * shape[2] + node[2]


@ti.func
def sleeping_lanes(fields: ti.template(), q):
    """Return a pack of integers, 1 in lanes of pack q that sleep."""
    bits = fields.sleepers.lanes_asleep[q]
    return ti.Vector([(bits >> l) & 1 for l in range(LANES)])


@ti.func
def list_awake_packs(fields: ti.template()):
    """List the packs with a lane that is awake, in order."""
    n = 0
    for body in range(fields.parameters.densities.shape[0]):
        ends = fields.particles.range_table[body]
        begin = n
        for q in range(ends[0], ends[1]):
            if fields.sleepers.lanes_asleep[q] != ALL_LANES:
                fields.sleepers.awake[n] = q
                n += 1
        fields.sleepers.ranges[body] = ti.Vector([begin, n])
    fields.sleepers.count[None] = n


@ti.func
def is_at_rest(P: ti.template(), q, l: ti.template()):
    """Return whether lane l of pack q has no velocity, as all have that sleep."""
    total = 0.0 * P.v[0][q][l]
    for d in ti.static(range(3)):
        total += ti.abs(P.v[d][q][l])
    for i in ti.static(range(9)):
        total += ti.abs(P.C[i][q][l])
    return total == 0.0


@ti.func
def adopt_rest(fields: ti.template(), P: ti.template()):
    """Set the sleeping lanes by the particles' `rest`; the nodes' sums are empty until they are added again."""
    calm_time = ti.cast(fields.sleepers.limits[CALM_TIME], fields.real)
    for q in range(P.pack_count[None]):
        base = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)[0]
        bits = 0
        for l in ti.static(range(LANES)):
            fields.sleepers.home[q][l] = place_of_node(fields, ti.Vector([base[d][l] for d in range(3)]))
            if P.volume[q][l] == 0.0:
                bits |= 1 << l
            elif P.rest[q][l] >= calm_time:
                if is_at_rest(P, q, l):
                    bits |= 1 << l
                else:  # a state that was written to
                    P.rest[q][l] = 0.0
        fields.sleepers.lanes_asleep[q] = bits
        fields.sleepers.lanes_summed[q] = 0
        fields.sleepers.version[q] = fields.sleepers.version[q] + 1
    for I in ti.grouped(ti.ndrange(*fields.sleepers.stencil_count.shape)):
        if fields.sleepers.stencil_count[I] > 0:
            fields.sleepers.stencil_count[I] = 0
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in ti.static(range(BLOCK)):
                    fields.sleepers.sums[I * BLOCK + ti.Vector([a, b, c])] = ti.Vector.zero(ti.i64, 4)
                    fields.sleepers.contribution[I * BLOCK + ti.Vector([a, b, c])] = ti.Vector.zero(fields.real, 4)
    list_awake_packs(fields)
    fields.sleepers.are_sums_stale[None] = 1
    fields.sleepers.is_disturbed[None] = 0
    # a failed advance has noted motion for its next check
    fields.sleepers.check[None] = fields.sleepers.check[None] + 2
