"""Walls and periodic sides, second order: what falls outside is folded to its place inside before the grid update,
and unfolded after it.

A wall lies on a plane of nodes. The mirrored half space closes the stencils of the grains beside it, so that the
wall acts where it is; zeroing nodes would displace it by about 0.18 cells and make the whole scheme first order.
A column (mirror node, wall node, ghost node) that pulls away from a separable wall is left unfolded. Periodic sides
come first and leave last: their outer nodes are images of inner ones.
"""

from mpm.backend import ti
from mpm.scene.grid import BLOCK, GHOST, activate, clear, in_first_layer
from mpm.scene.walls import FRICTION, PERIODIC, ROLLER, SLIP, STICK
from mpm.state.ledger import WALL_ROW, add, position

TINY = 1e-37
"""Smallest momentum [N s] to divide by: above the numbers that lose digits in single precision."""


class NoTape:
    """What `unfold` is given where nobody wants to go back."""

    keeps = False


@ti.func
def mirrored(q, n, condition):
    """Momentum (or velocity), a 4-vector, as its mirror image in the wall with normal n carries it."""
    image = q - 2.0 * q.dot(n) * n
    if condition == STICK:
        image = -q
    return image


@ti.func
def folded_earlier(grid: ti.template(), table: ti.template(), I, axis):
    """Whether the node lies outside a side that is folded before this axis: its momentum has moved on already."""
    J = in_first_layer(grid, I)
    last = ti.static([GHOST + n - 1 for n in grid.cells])  # a periodic side ends a node before its wall would
    hidden = False
    if J.min() < GHOST or J[0] > last[0] or J[1] > last[1] or J[2] > last[2]:
        hidden = outside_earlier(table, J, axis)
    return hidden


@ti.func
def outside_earlier(table: ti.template(), J, axis):
    """The same for a node outside some side."""
    hidden = False
    for side in ti.static(range(6)):
        if table[side, 3] == PERIODIC or side // 2 < axis:
            if ti.static(side % 2 == 0):
                hidden = hidden or J[side // 2] < table[side, 1]
            else:
                hidden = hidden or J[side // 2] > table[side, 1]
    return hidden


@ti.func
def unit(axis):
    """Unit vector (3,) of an axis, as integers."""
    return ti.Vector([ti.cast(axis == 0, ti.i32), ti.cast(axis == 1, ti.i32), ti.cast(axis == 2, ti.i32)])


@ti.func
def column(grid: ti.template(), block, a, b, axis, node):
    """Node (3,) on a plane of nodes through place (a, b) of a block's face, in the block's layer."""
    e = unit(axis)
    corner = block * BLOCK
    I = corner * (1 - e) + node * e + a * unit((axis + 1) % 3) + b * unit((axis + 2) % 3)
    if axis == 0 and corner[0] >= grid.width:
        I[0] += grid.width  # in the second layer
    return I


@ti.func
def on_plane(grid: ti.template(), block, axis, node):
    """Whether a block holds nodes of a plane."""
    return (in_first_layer(grid, block * BLOCK).dot(unit(axis)) // BLOCK) == node // BLOCK


@ti.func
def ghost_mass(grid: ti.template(), ghost, stamp):
    """Mass of a ghost node; zero when its block is not active, negative once folded."""
    mass = ti.cast(0, grid.nodes.dtype)
    if grid.stamp[ghost // BLOCK] == stamp:
        mass = grid.nodes[ghost][3]
    return mass


@ti.func
def normal4(axis, inward, real: ti.template()):
    """Inward normal with a fourth entry for the mass."""
    e = unit(axis) * inward
    return ti.Vector([ti.cast(e[0], real), ti.cast(e[1], real), ti.cast(e[2], real), ti.cast(0, real)])


@ti.func
def home_node(grid: ti.template(), I, periodic: ti.template(), cells: ti.template()):
    """The node inside that an outer node of periodic axes is an image of; I itself where it is inside."""
    home = I
    J = in_first_layer(grid, I)
    for d in ti.static(range(3)):
        if ti.static(periodic[d]):
            home[d] += GHOST + (J[d] - GHOST + 2 * cells[d]) % cells[d] - J[d]
    return home


@ti.func
def open_homes(grid: ti.template(), periodic: ti.template(), cells: ti.template(), stamp):
    """Put on the list what `fold_periodic` would: for those who must know all active blocks before it."""
    before = grid.count[None]
    for active in range(before):
        block = grid.active[active] * BLOCK
        for a, b, c in ti.ndrange(BLOCK, BLOCK, BLOCK):
            activate(grid, home_node(grid, block + ti.Vector([a, b, c]), periodic, cells) // BLOCK, stamp)
    clear(grid, before, grid.count[None])


@ti.func
def fold_periodic(grid: ti.template(), periodic: ti.template(), cells: ti.template(), stamp):
    """Add the momentum of images to their home nodes; an image keeps a negative mass until it is given back."""
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
def unfold_periodic(grid: ti.template(), periodic: ti.template(), cells: ti.template()):
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


@ti.func
def fold(grid: ti.template(), table: ti.template(), stamp, dt, gravity):
    """Add ghost momentum and mass to the mirror nodes; a folded ghost keeps its raw values, its mass negated."""
    for w in range(6):
        fold_wall(grid, table, w, stamp, dt, gravity, 0, grid.count[None])


@ti.func
def fold_wall(grid: ti.template(), table: ti.template(), w, stamp, dt, gravity, first, last):
    """`fold` of one wall, in the active blocks first .. last - 1."""
    axis, node, inward, condition = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
    n = normal4(axis, inward, grid.nodes.dtype)
    fall = dt * (gravity[0] * n[0] + gravity[1] * n[1] + gravity[2] * n[2])
    for active in range(first, last):
        block = grid.active[active]
        if condition != PERIODIC and on_plane(grid, block, axis, node):
            for a, b in ti.ndrange(BLOCK, BLOCK):
                W = column(grid, block, a, b, axis, node)
                at_wall = grid.nodes[W]
                # a stencil that reaches a ghost reaches the wall's node too; in the second layer the mirror node
                # may hold the other side's material, and the shell stops what is there
                if at_wall[3] > 0 and W[0] < grid.width:
                    ghost = W - unit(axis) * inward
                    m_g = ghost_mass(grid, ghost, stamp)
                    if m_g > 0 and not folded_earlier(grid, table, W, axis):
                        mirror = W + unit(axis) * inward
                        raw = grid.nodes[ghost]
                        image = mirrored(raw, n, condition)
                        image[3] = m_g
                        sum = grid.nodes[mirror] + image
                        # the impulse that would hold the column; a pull means that it is leaving
                        pushed = -(at_wall.dot(n) + at_wall[3] * fall) \
                            - 2.0 * (m_g * (sum.dot(n) / sum[3] + fall) + raw.dot(n))
                        if condition == ROLLER or condition == STICK or pushed > 0:
                            grid.nodes[mirror] = sum
                            raw[3] = -m_g
                            grid.nodes[ghost] = raw


@ti.func
def unfold(grid: ti.template(), table: ti.template(), stamp, friction, origin, cell, out: ti.template(),
           tape: ti.template()):
    """Give ghosts the mirrored velocity, hold the wall's nodes, credit the impulses to the ledger's wall row. A tape
    that keeps is shown every column before it is unfolded."""
    for back in range(6):
        unfold_wall(grid, table, 5 - back, stamp, friction, origin, cell, out, tape, 0, grid.count[None])


@ti.func
def unfold_wall(grid: ti.template(), table: ti.template(), w, stamp, friction, origin, cell, out: ti.template(),
                tape: ti.template(), first, last):
    """`unfold` of one wall, in the active blocks first .. last - 1."""
    axis, node, inward, condition = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
    n = normal4(axis, inward, grid.nodes.dtype)
    total, moment = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    for active in range(first, last):
        block = grid.active[active]
        if condition != PERIODIC and on_plane(grid, block, axis, node):
            for a, b in ti.ndrange(BLOCK, BLOCK):
                W = column(grid, block, a, b, axis, node)
                if ti.static(tape.keeps):
                    tape.keep(grid, w, W, axis, inward, stamp)
                if grid.nodes[W][3] != 0:
                    impulse, across = unfold_column(grid, table, W, axis, inward, condition, n, stamp, friction)
                    total += ti.cast(impulse, ti.f64)
                    place = position(in_first_layer(grid, W), origin, cell)
                    moment += place.cross(ti.cast(impulse, ti.f64)) + cell * ti.cast(across, ti.f64)
    for d in ti.static(range(3)):
        add(out, WALL_ROW, d, total[d])
        add(out, WALL_ROW, 3 + d, moment[d])


@ti.func
def unfold_column(grid: ti.template(), table: ti.template(), W, axis, inward, condition, n, stamp, friction):
    """One column of `unfold`: wall node W, its ghost and its mirror node.

    Returns the column's impulse (3,), and the moment (3,) per cell of what acts beside the wall node.
    """
    ghost = W - unit(axis) * inward
    m_g = ghost_mass(grid, ghost, stamp)
    pair = ti.cast(0, grid.nodes.dtype)
    slide = friction
    met = condition
    impulse, lever = 0.0 * n, 0.0 * n  # lever: difference of the impulses at mirror and ghost
    hidden = folded_earlier(grid, table, W, axis)
    if hidden:  # ghosts of an earlier wall that are leaving it may not enter this one either
        met = SLIP
        slide = friction * 0.0
    elif m_g < 0:
        mirror = W + unit(axis) * inward
        raw = grid.nodes[ghost]
        u = grid.nodes[mirror]
        image = mirrored(u, n, condition)
        given = -m_g * image - raw
        taken = mirrored(given, n, condition)
        pair = (given - taken).dot(n)
        impulse, lever = given - taken, -given - taken
        image[3] = -m_g
        grid.nodes[ghost] = image
        u[3] += m_g  # back to its own mass, which later credits count
        grid.nodes[mirror] = u
    if m_g > 0:  # an unfolded ghost may leave, not enter
        stopped = stop_node(grid, ghost, n, SLIP, False, pair, friction)
        impulse, lever = impulse + stopped, lever - stopped
    impulse += stop_node(grid, W, n, met, m_g < 0 and not hidden, pair, slide)
    return three(impulse), three(n).cross(three(lever))


@ti.func
def three(q):
    """The first three entries of a 4-vector."""
    return ti.Vector([q[0], q[1], q[2]])


@ti.func
def stop_node(grid: ti.template(), I, n, condition, held, pair, friction):
    """Apply the wall's condition to a node, returns its impulse; `pair` is the normal impulse of the folded pair, which
    adds to friction."""
    q = grid.nodes[I]
    impulse = 0.0 * q
    if q[3] > 0:
        mass = q[3]
        q[3] = 0.0
        into = q.dot(n)
        v = q
        if condition == STICK:
            v = q * 0.0
        elif condition == ROLLER or held or into < 0:
            v = q - into * n
        if condition == FRICTION:
            slide = q - into * n
            push = ti.max(mass * (v.dot(n) - into) + pair, 0.0)
            # the momentum of a node at the very edge of a stencil can be too small for a number: then it is TINY
            left = ti.max(1.0 - friction * push / ti.max(mass * slide.norm(1e-15), TINY), 0.0)
            v = v.dot(n) * n + left * slide
        impulse = mass * (v - q)
        impulse[3] = 0.0
        v[3] = mass
        grid.nodes[I] = v
    return impulse
