"""Periodic sides: nodes beyond a side are images of nodes inside, folded before walls and unfolded after them.
Every node takes what it needs from others and writes to itself alone, so that any number of threads may do so."""

from mpm.backend import ti
from mpm.scene.grid import BLOCK, GHOST
from mpm.state.active_blocks import activate
from mpm.state.nodes import in_first_layer, node_of

BEYOND = 2  # nodes that stencils of particles inside reach beyond a side, at most


@ti.func
def home_node(fields: ti.template(), I):
    """Return the node inside that an outer node of periodic axes is an image of; I itself where it is inside."""
    home = I
    J = in_first_layer(fields.grid, I)
    for d in ti.static(range(3)):
        if ti.static(fields.features.periodic[d]):
            home[d] += GHOST + (J[d] - GHOST + 2 * fields.cells[d]) % fields.cells[d] - J[d]
    return home


@ti.func
def activate_home_nodes(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where mass is transferred, activate the blocks whose nodes have images in blocks first .. last - 1."""
    if step.transfer_mass > 0:
        for n in range(first, last):
            block = fields.grid.active[n]
            for m in range(BLOCK**3 // step.threads):
                I = node_of(block, step.threads * m + step.thread)
                home = home_node(fields, I)
                if (home != I).any() and is_reached(fields, in_first_layer(fields.grid, I)):
                    activate(fields.grid, home // BLOCK, step.stamp)


@ti.func
def is_reached(fields: ti.template(), J):
    """Return whether stencils of particles inside can reach a node of the first layer, along the periodic axes."""
    reached = True
    for d in ti.static(range(3)):
        if ti.static(fields.features.periodic[d]):
            reached = reached and J[d] >= GHOST - BEYOND and J[d] < GHOST + fields.cells[d] + BEYOND
    return reached


@ti.func
def sum_images(fields: ti.template(), I, stamp):
    """Return momentum or velocity, and mass without its sign (4,), summed over the images of a node inside."""
    total = ti.Vector.zero(fields.real, 4)
    J = in_first_layer(fields.grid, I)
    # along an axis an image lies one period away, or two where a period is shorter than what stencils reach
    far = ti.static([(2 if fields.cells[d] < 3 else 1) * fields.features.periodic[d] for d in range(3)])
    near_side = False
    for d in ti.static(range(3)):
        if ti.static(fields.features.periodic[d]):
            near_side = near_side or J[d] < GHOST + BEYOND or J[d] >= GHOST + fields.cells[d] - BEYOND
    if near_side:
        for a, b, c in ti.static(ti.ndrange((-far[0], far[0] + 1), (-far[1], far[1] + 1), (-far[2], far[2] + 1))):
            if ti.static((a, b, c) != (0, 0, 0)):
                away = ti.Vector([ti.static(a * fields.cells[0]), ti.static(b * fields.cells[1]),
                                  ti.static(c * fields.cells[2])])
                if is_reached(fields, J + away):
                    image = I + away
                    if fields.grid.stamp[image // BLOCK] == stamp:
                        q = fields.grid.nodes[image]
                        q[3] = ti.abs(q[3])
                        total += q
    return total


@ti.func
def fold_periodic(fields: ti.template(), step: ti.template(), first, last):
    """Phase: add the momentum of images to their home nodes, in active blocks first .. last - 1."""
    for n in range(first, last):
        block = fields.grid.active[n]
        for m in range(BLOCK**3 // step.threads):
            I = node_of(block, step.threads * m + step.thread)
            if (home_node(fields, I) == I).all():
                fields.grid.nodes[I] = fields.grid.nodes[I] + sum_images(fields, I, step.stamp)


@ti.func
def mark_images(fields: ti.template(), step: ti.template(), first, last):
    """Phase: negate the masses of folded images, which the grid update leaves out, in blocks first .. last - 1."""
    for n in range(first, last):
        block = fields.grid.active[n]
        for m in range(BLOCK**3 // step.threads):
            I = node_of(block, step.threads * m + step.thread)
            if (home_node(fields, I) != I).any():
                fields.grid.nodes[I][3] = -fields.grid.nodes[I][3]


@ti.func
def unfold_periodic(fields: ti.template(), step: ti.template(), first, last):
    """Phase: give images the velocity of their home nodes, and each its own mass, which the next substep may need.
    At the end of a stride both keep what is folded there, by which particles note the density. In active blocks first
    .. last - 1."""
    whole = ti.static(fields.features.density_state and not fields.features.sleep) and step.span > 0
    for n in range(first, last):
        block = fields.grid.active[n]
        for m in range(BLOCK**3 // step.threads):
            I = node_of(block, step.threads * m + step.thread)
            home = home_node(fields, I)
            if (home == I).all():
                if not whole:
                    fields.grid.nodes[I][3] = fields.grid.nodes[I][3] - sum_images(fields, I, step.stamp)[3]
            elif fields.grid.nodes[I][3] < 0:
                u = fields.grid.nodes[home]
                fields.grid.nodes[I] = ti.Vector([u[0], u[1], u[2], ti.select(whole, u[3], -fields.grid.nodes[I][3])])
