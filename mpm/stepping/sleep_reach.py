"""Blocks of nodes in reach of a moving collider: no particle sleeps there."""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.geometry.rigid_motion import LINEAR
from mpm.geometry.shell import SHELL_FACE
from mpm.motion.mobile_motion import TWIST
from mpm.scene.grid import BLOCK
from mpm.state.ledger import position
from mpm.state.sleepers import AHEAD, place_of_block

STENCIL = BLOCK + 2
"""Nodes along each axis that the stencils of a block's particles can reach."""
HALF_DIAGONAL = 0.5 * (STENCIL - 1) * 3**0.5
"""Cells from the middle of those nodes to the farthest."""
SURPRISE = 2.0
"""How many times as far as at its present speed a mobile collider may get until the next check."""


@ti.func
def find_near_blocks(fields: ti.template(), launch: ti.template(), row, rows, stamp: ti.i32):
    """Note the blocks with particles that moving colliders can reach within `rows` substeps, from row `row` on.
    stamp: of active blocks."""
    for k, index in ti.static(enumerate(fields.features.moving_colliders)):
        travel = ti.cast(0.0, fields.real)
        radius = ti.static(fields.colliders[index].sdf.radius)
        if ti.static(fields.mobile_place[index] >= 0):
            V = [launch.mobile[fields.mobile_place[index], TWIST + i] for i in ti.static(range(6))]
            speed = ti.Vector(V[:3]).norm() + radius * ti.Vector(V[3:]).norm()
            travel = ti.cast(SURPRISE * rows * launch.dt * speed, fields.real)
        else:
            for s in range(row, row + rows):
                V = [launch.motion[k, s, LINEAR + i] for i in ti.static(range(6))]
                travel += launch.dt * (ti.Vector(V[:3]).norm() + radius * ti.Vector(V[3:]).norm())
        margin = ti.static((HALF_DIAGONAL + SHELL_FACE + AHEAD) * fields.cell)
        note_blocks(fields, k, index, launch.motion, row, travel + margin, stamp)


@ti.func
def note_blocks(fields: ti.template(), k: ti.template(), index: ti.template(), motion: ti.template(), row, reach,
                stamp: ti.i32):
    """Note the blocks the middle of whose particles' stencils is closer than reach [m] to a collider."""
    c, R = collider_origin(motion, k, row), collider_axes(motion, k, row)
    ball = ti.static(fields.colliders[index].sdf.radius) + reach
    shape = ti.static(fields.sleepers.near.shape)
    first, last = ti.Vector([0, 0, 0]), ti.Vector([shape[0] - 1, shape[1] - 1, shape[2] - 1])
    for d in ti.static(range(3)):  # before the cast: a plane's ball is larger than integers are
        middle = (c[d] - fields.origin[d]) / fields.cell
        first[d] = ti.cast(ti.max(ti.min((middle - ball / fields.cell) / BLOCK - 1.0, shape[d] * 1.0), 0.0), ti.i32)
        last[d] = ti.cast(ti.min(ti.max((middle + ball / fields.cell) / BLOCK, -1.0), shape[d] - 1.0), ti.i32)
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            for b in range(first[2], last[2] + 1):
                block = ti.Vector([i, j, b])
                has_sleepers = fields.sleepers.stencil_count[block] > 0 or fields.sleepers.are_sums_stale[None] > 0
                if has_sleepers or fields.grid.stamp[block] == stamp:
                    middle = position(block * BLOCK, fields.world_origin(), fields.cell)
                    r = ti.cast(middle, fields.real) + 0.5 * (STENCIL - 1) * fields.cell - c
                    if r.norm_sqr() < ball * ball \
                            and fields.colliders[index].sdf.least_distance(R.transpose() @ r) < reach:
                        fields.sleepers.near[block] = fields.sleepers.search[None]
                        if has_sleepers:
                            fields.sleepers.disturbed_at[place_of_block(fields, block)] = fields.sleepers.check[None]
                            fields.sleepers.is_disturbed[None] = 1
