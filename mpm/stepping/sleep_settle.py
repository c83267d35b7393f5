"""What the nodes that sleepers share with waking particles did in a stride."""

from mpm.backend import ti
from mpm.scene.grid import BLOCK
from mpm.state.ledger import add, position
from mpm.state.sleepers import PUSH, place_of_block

NOTICED = 0.05
"""Share of the displacement that wakes from which on a node's is looked at."""
LIGHT = 1e-4
"""Share of a cell's mass below which a node does not wake its sleepers: its velocity is noise."""


@ti.func
def stir(fields: ti.template(), block, look):
    """Note the blocks in which the stencils begin that reach a block whose nodes were pushed."""
    for i in range(ti.max(block[0] - 1, 0), block[0] + 1):
        for j in range(ti.max(block[1] - 1, 0), block[1] + 1):
            for k in range(ti.max(block[2] - 1, 0), block[2] + 1):
                fields.sleepers.stirred[place_of_block(fields, ti.Vector([i, j, k]))] = look
    fields.sleepers.disturbed[None] = 1


@ti.func
def settle_with_sleepers(fields: ti.template(), step: ti.template(), first, last):
    """Phase: at the end of a stride, credit what sleepers gave to nodes and took up there, and note pushed nodes.

    Nodes of active blocks first .. last - 1. The ledger's row `asleep` gets the forces of sleepers on nodes, less the
    momentum of their mass, which the next stride begins without.
    """
    if step.span > 0:
        noticed, look = ti.cast(NOTICED * fields.sleepers.limits[PUSH], fields.real), fields.sleepers.look[None] + 1
        time = step.span * step.dt
        light = LIGHT * fields.parameters.densities[0] * fields.cell ** 3
        total, moment = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
        for n in range(first, last):
            pushed = 0
            block = fields.grid.active[n]
            if block[0] < fields.grid.width // BLOCK and fields.sleepers.shares[block] > 0:
                for a, b, c in ti.ndrange(BLOCK, BLOCK, BLOCK):
                    I = block * BLOCK + ti.Vector([a, b, c])
                    given, q = fields.sleepers.given[I], fields.grid.nodes[I]
                    if given[3] > 0:
                        v = ti.Vector([q[0], q[1], q[2]])
                        p = ti.Vector([ti.cast(time * given[d] - given[3] * v[d], ti.f64) for d in range(3)])
                        total += p
                        moment += position(I, fields.world_origin(), fields.cell).cross(p)
                        if given[3] > light:
                            path = time * v
                            if fields.sleepers.window[I] == look:
                                path += fields.sleepers.path[I]
                            fields.sleepers.window[I] = look
                            fields.sleepers.path[I] = path
                            if path.norm_sqr() > noticed * noticed:
                                pushed = 1
            if pushed > 0:
                stir(fields, block, look)
        for d in ti.static(range(3)):
            add(step.out, fields.rows.asleep, d, total[d])
            add(step.out, fields.rows.asleep, 3 + d, moment[d])
