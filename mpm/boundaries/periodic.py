"""Periodic sides: nodes beyond a side are images of nodes inside, folded before walls and unfolded after them."""

from mpm.backend import ti
from mpm.scene.grid import BLOCK, GHOST
from mpm.state.active_blocks import activate
from mpm.state.nodes import clear, in_first_layer


@ti.func
def home_node(grid: ti.template(), I, periodic: ti.template(), cells: ti.template()):
    """Return the node inside that an outer node of periodic axes is an image of; I itself where it is inside."""
    home = I
    J = in_first_layer(grid, I)
    for d in ti.static(range(3)):
        if ti.static(periodic[d]):
            home[d] += GHOST + (J[d] - GHOST + 2 * cells[d]) % cells[d] - J[d]
    return home


@ti.func
def activate_home_nodes(grid: ti.template(), periodic: ti.template(), cells: ti.template(), stamp):
    """Activate the blocks that `fold_periodic` would, for phases before it that need all active blocks."""
    before = grid.count[None]
    for active in range(before):
        block = grid.active[active] * BLOCK
        for a, b, c in ti.ndrange(BLOCK, BLOCK, BLOCK):
            activate(grid, home_node(grid, block + ti.Vector([a, b, c]), periodic, cells) // BLOCK, stamp)
    clear(grid, before, grid.count[None])


@ti.func
def fold_periodic(fields: ti.template(), step: ti.template(), first, last):
    """Phase: add the momentum of images to their home nodes; an image keeps a negative mass until it is unfolded."""
    fold_images(fields.grid, fields.features.periodic, fields.cells, step.stamp)


@ti.func
def fold_images(grid: ti.template(), periodic: ti.template(), cells: ti.template(), stamp):
    """Add the momentum of images to their home nodes; an image keeps a negative mass."""
    for active in range(grid.count[None]):
        block = grid.active[active] * BLOCK
        for a, b, c in ti.ndrange(BLOCK, BLOCK, BLOCK):
            I = block + ti.Vector([a, b, c])
            home = home_node(grid, I, periodic, cells)
            q = grid.nodes[I]
            if (home != I).any() and q[3] > 0:
                if grid.stamp[home // BLOCK] != stamp:
                    activate(grid, home // BLOCK, stamp)
                    clear(grid, grid.count[None] - 1, grid.count[None])
                grid.nodes[home] = grid.nodes[home] + q
                q[3] = -q[3]
                grid.nodes[I] = q


@ti.func
def unfold_periodic(fields: ti.template(), step: ti.template(), first, last):
    """Phase: give images the velocity of their home nodes."""
    unfold_images(fields.grid, fields.features.periodic, fields.cells)


@ti.func
def unfold_images(grid: ti.template(), periodic: ti.template(), cells: ti.template()):
    """Give images the velocity of their home nodes."""
    for active in range(grid.count[None]):
        block = grid.active[active] * BLOCK
        for a, b, c in ti.ndrange(BLOCK, BLOCK, BLOCK):
            I = block + ti.Vector([a, b, c])
            home = home_node(grid, I, periodic, cells)
            mass = -grid.nodes[I][3]
            if (home != I).any() and mass > 0:
                u = grid.nodes[home]
                grid.nodes[I] = ti.Vector([u[0], u[1], u[2], mass])
                u[3] -= mass  # each its own, which a substep without transfer starts from
                grid.nodes[home] = u
