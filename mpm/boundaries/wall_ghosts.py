"""Walls and periodic sides, second order: what falls outside is folded to its place inside before the grid update, and
unfolded after it. A wall lies on a plane of nodes. The mirrored half space closes the stencils of the particles next to
it, so that the wall acts where it is; zeroing nodes would displace it by about 0.18 cells and make the whole scheme
first order. A column (mirror node, wall node, ghost node) that pulls away from a separable wall is left unfolded.
Periodic sides come first and leave last: their outer nodes are images of inner ones."""

from mpm.backend import ti
from mpm.scene.grid import BLOCK, GHOST
from mpm.scene.walls import IS_FREE, IS_PERIODIC
from mpm.state.ledger import WALL_ROW, add, position
from mpm.state.nodes import in_first_layer

WALL_GAP = 0.02
"""Largest estimated gap [cells] between a wall that can be left and the material that it stops. One grain a cell, at
rest on it, has 0.016; with 0.1, a block that is thrown up and lands lies 3 to 5 % too high."""
CLOSE = 0.05
"""Mass of a ghost relative to its wall node from which a grain is nearer than material that lies at the wall, where it
is 0.04, and 0.03 on a lattice of two grains a cell. Grains in a gap of others would be squeezed through the wall."""


SURFACE_DISTANCE = ((0.0, 1.5, -12.5), (0.04, 1.0, -3.125), (0.2, 0.5, -1.613), (0.51, 0.0, -1.53))
"""Mass of a node relative to that of the next one along the normal, distance [cells] from the node to the material's
surface, and its slope up to the next row: by the B-splines of a filled half space."""


class NoTape:
    """The tape of a substep that no adjoint follows."""

    records = False


@ti.func
def mirror(conditions: ti.template(), kind, q, mass, n, p):
    """Return the mirror image, in the wall with normal n, of the momentum q (4,) of a mass; of a velocity with mass 1.
    kind: place of the wall's condition among the scene's. p: its numbers."""
    into = q.dot(n)
    t = q - into * n
    t[3] = 0.0
    image = t
    for index, condition in ti.static(enumerate(conditions)):
        if kind == index:
            image = condition.mirror(t, mass, p)
    return image - (image.dot(n) + into) * n


@ti.func
def folded_earlier(grid: ti.template(), table: ti.template(), I, axis):
    """Return whether the node lies outside a side that is folded before this axis: its momentum has moved on."""
    J = in_first_layer(grid, I)
    last = ti.static([GHOST + n - 1 for n in grid.cells])  # a periodic side ends a node before its wall would
    hidden = False
    if J.min() < GHOST or J[0] > last[0] or J[1] > last[1] or J[2] > last[2]:
        hidden = outside_earlier(table, J, axis)
    return hidden


@ti.func
def outside_earlier(table: ti.template(), J, axis):
    """Return `folded_earlier` for a node outside some side."""
    hidden = False
    for side in ti.static(range(6)):
        if table[side, 3] == IS_PERIODIC or side // 2 < axis:
            if ti.static(side % 2 == 0):
                hidden = hidden or J[side // 2] < table[side, 1]
            else:
                hidden = hidden or J[side // 2] > table[side, 1]
    return hidden


@ti.func
def unit(axis):
    """Return the unit vector (3,) of an axis, as integers."""
    return ti.Vector([ti.cast(axis == 0, ti.i32), ti.cast(axis == 1, ti.i32), ti.cast(axis == 2, ti.i32)])


@ti.func
def column(grid: ti.template(), block, a, b, axis, node):
    """Return the node (3,) on a plane of nodes at place (a, b) of a block's face, in the block's layer."""
    e = unit(axis)
    corner = block * BLOCK
    I = corner * (1 - e) + node * e + a * unit((axis + 1) % 3) + b * unit((axis + 2) % 3)
    if axis == 0 and corner[0] >= grid.width:
        I[0] += grid.width  # in the second layer
    return I


@ti.func
def column_of(number):
    """Return the place (a, b) of a column, 0 to 15, on a block's face."""
    return number // BLOCK, number % BLOCK


@ti.func
def on_plane(grid: ti.template(), block, axis, node):
    """Return whether a block holds nodes of a plane."""
    return (in_first_layer(grid, block * BLOCK).dot(unit(axis)) // BLOCK) == node // BLOCK


@ti.func
def lies_at_wall(fields: ti.template(), step: ti.template(), W, behind, ghost, approach):
    """Return whether the material at node W of a wall lies at it, in half of the rest of a stride at the latest, by the
    masses of this node, of the node behind and of the ghost.
    What is still on its way feels nothing: stopped where its nodes reach the wall, it would come to rest in the air.
    approach: velocity [m/s] of node W towards the wall. Across a shell the masses say nothing: there the wall acts."""
    mass = fields.grid.nodes[W][3]
    share = mass / ti.max(ghost_mass(fields.grid, behind, step.stamp), 1e-30)
    way = 0.5 * (step.stride - step.dt) / fields.cell * ti.max(approach, 0.0)
    result = distance_to_material(share) - way < WALL_GAP or ghost > CLOSE * mass
    if ti.static(len(fields.features.shells) > 0):
        sides = [fields.shells.side[in_first_layer(fields.grid, I)] for I in (W, behind)]
        result = result or sides[0] != sides[1]
    return result


@ti.func
def distance_to_material(share):
    """Return the distance [cells] from a node to the material's surface, by `SURFACE_DISTANCE`."""
    cells = 0.0 * share
    for least, cells_there, slope in ti.static(SURFACE_DISTANCE):
        if share >= least:
            cells = cells_there + slope * (share - least)
    return cells


@ti.func
def ghost_mass(grid: ti.template(), ghost, stamp):
    """Return the mass of a ghost node; zero when its block is not active, negative once folded."""
    mass = ti.cast(0, grid.nodes.dtype)
    if grid.stamp[ghost // BLOCK] == stamp:
        mass = grid.nodes[ghost][3]
    return mass


@ti.func
def normal4(axis, inward, real: ti.template()):
    """Return the inward normal with a fourth entry, zero, for the mass."""
    e = unit(axis) * inward
    return ti.Vector([ti.cast(e[0], real), ti.cast(e[1], real), ti.cast(e[2], real), ti.cast(0, real)])


@ti.func
def fold_walls(fields: ti.template(), step: ti.template(), w, first, last):
    """Phase: add ghost momentum and mass at wall w to the mirror nodes, in active blocks first .. last - 1.
    A folded ghost keeps its raw values, its mass negated."""
    grid, table, conditions = ti.static((fields.grid, fields.parameters.walls, fields.wall_conditions))
    p, gravity = fields.parameters.wall_numbers[w], fields.parameters.gravity[None]
    axis, node, inward, kind, separable = table[w, 0], table[w, 1], table[w, 2], table[w, 3], table[w, 4]
    n = normal4(axis, inward, grid.nodes.dtype)
    fall = step.kick * (gravity[0] * n[0] + gravity[1] * n[1] + gravity[2] * n[2])
    for active in range(first, last):
        block = grid.active[active]
        if kind != IS_PERIODIC and on_plane(grid, block, axis, node):
            for m in range(BLOCK**2 // step.columns):
                a, b = column_of(step.columns * m + step.column)
                W = column(grid, block, a, b, axis, node)
                at_wall = grid.nodes[W]
                # a stencil that reaches a ghost reaches the wall's node too; in the second layer the mirror node
                # may hold the other side's material, and the shell stops what is there
                if at_wall[3] > 0 and W[0] < grid.width:
                    ghost = W - unit(axis) * inward
                    m_g = ghost_mass(grid, ghost, step.stamp)
                    if m_g > 0 and not folded_earlier(grid, table, W, axis):
                        partner = W + unit(axis) * inward
                        raw = grid.nodes[ghost]
                        image = mirror(conditions, kind, raw, m_g, n, p)
                        image[3] = m_g
                        sum = grid.nodes[partner] + image
                        # the impulse that would hold the column; a pull means that it is leaving
                        pushed = -(at_wall.dot(n) + at_wall[3] * fall) \
                            - 2.0 * (m_g * (sum.dot(n) / sum[3] + fall) + raw.dot(n))
                        if separable == 0 or (pushed > 0 and lies_at_wall(fields, step, W, partner, m_g,
                                                                          -at_wall.dot(n) / at_wall[3])):
                            grid.nodes[partner] = sum
                            raw[3] = -m_g
                            grid.nodes[ghost] = raw


@ti.func
def unfold_walls(fields: ti.template(), step: ti.template(), w, first, last):
    """Phase: give ghosts the mirrored velocity, stop nodes on walls, in active blocks first .. last - 1.
    Walls are unfolded in the reverse order of folding: w counts from the last one. Their impulses are credited to the
    ledger's wall row. A tape records every column before it is unfolded."""
    unfold_wall(fields, step, 5 - w, first, last)


@ti.func
def unfold_wall(fields: ti.template(), step: ti.template(), w, first, last):
    """Unfold the ghosts of one wall, see `unfold_walls`."""
    grid, table, conditions = ti.static((fields.grid, fields.parameters.walls, fields.wall_conditions))
    p, origin, cell, row = fields.parameters.wall_numbers[w], fields.world_origin(), fields.cell, fields.rows.walls + w
    axis, node, inward, kind, separable = table[w, 0], table[w, 1], table[w, 2], table[w, 3], table[w, 4]
    n = normal4(axis, inward, grid.nodes.dtype)
    total, moment, touched = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3), 0
    for active in range(first, last):
        block = grid.active[active]
        if kind != IS_PERIODIC and on_plane(grid, block, axis, node):
            for m in range(BLOCK**2 // step.columns):
                a, b = column_of(step.columns * m + step.column)
                W = column(grid, block, a, b, axis, node)
                ghost, meets = ghost_mass(grid, W - unit(axis) * inward, step.stamp), True
                if grid.nodes[W][3] != 0 and separable > 0 and ghost >= 0:
                    meets = lies_at_wall(fields, step, W, W + unit(axis) * inward, ghost, -grid.nodes[W].dot(n))
                if ti.static(step.tape.records):
                    step.tape.record(grid, w, W, axis, inward, step.stamp, meets)
                if grid.nodes[W][3] != 0:
                    impulse, across = unfold_column(grid, table, conditions, W, axis, inward, kind, separable, n, step,
                                                    meets, p)
                    touched = 1
                    total += ti.cast(impulse, ti.f64)
                    place = position(in_first_layer(grid, W), origin, cell)
                    moment += place.cross(ti.cast(impulse, ti.f64)) + cell * ti.cast(across, ti.f64)
    if touched > 0:
        for d in ti.static(range(3)):
            add(step.out, WALL_ROW, d, total[d])
            add(step.out, WALL_ROW, 3 + d, moment[d])
            add(step.out, row, d, total[d])
            add(step.out, row, 3 + d, moment[d])


@ti.func
def unfold_column(grid: ti.template(), table: ti.template(), conditions: ti.template(), W, axis, inward, kind,
                  separable, n, step: ti.template(), meets, p):
    """Unfold one column: wall node W, its ghost and its mirror node; meets: whether its material lies at the wall.
    Return the column's impulse (3,), and the moment (3,) per cell of what acts beside the wall node."""
    ghost = W - unit(axis) * inward
    m_g = ghost_mass(grid, ghost, step.stamp)
    pair = ti.cast(0, grid.nodes.dtype)
    met, leaves = kind, separable
    impulse, lever = 0.0 * n, 0.0 * n  # lever: difference of the impulses at mirror and ghost
    hidden = folded_earlier(grid, table, W, axis)
    if hidden:  # ghosts of an earlier wall that are leaving it may not enter this one either
        met, leaves = IS_FREE, 1
    elif m_g < 0:
        partner = W + unit(axis) * inward
        raw = grid.nodes[ghost]
        u = grid.nodes[partner]
        image = mirror(conditions, kind, u, 1.0, n, p)
        given = -m_g * image - raw
        taken = -m_g * u - mirror(conditions, kind, raw, -m_g, n, p)
        pair = (given - taken).dot(n)
        impulse, lever = given - taken, -given - taken
        image[3] = -m_g
        grid.nodes[ghost] = image
        u[3] += m_g  # back to its own mass, which later credits count
        grid.nodes[partner] = u
    if m_g > 0 and meets:  # an unfolded ghost may leave, not enter
        stopped = stop_node(grid, ti.static(()), ghost, n, IS_FREE, 1, False, pair, step.kick, p)
        impulse, lever = impulse + stopped, lever - stopped
    if meets:
        impulse += stop_node(grid, conditions, W, n, met, leaves, m_g < 0 and not hidden, pair, step.kick, p)
    return three(impulse), three(n).cross(three(lever))


@ti.func
def three(q):
    """Return the first three entries of a 4-vector."""
    return ti.Vector([q[0], q[1], q[2]])


@ti.func
def stop_node(grid: ti.template(), conditions: ti.template(), I, n, kind, separable, held, pair, dt, p):
    """Apply the wall's condition to a node; return its impulse.
    pair: normal impulse of the folded pair, which adds to friction."""
    q = grid.nodes[I]
    impulse = 0.0 * q
    if q[3] > 0:
        mass = q[3]
        q[3] = 0.0
        into = q.dot(n)
        kept = into
        if separable == 0 or held or into < 0:
            kept = 0.0
        push = ti.max(mass * (kept - into) + pair, 0.0)
        t = q - into * n
        slid = t
        for index, condition in ti.static(enumerate(conditions)):
            if kind == index:
                slid = condition.slide(t, n, mass, push, dt, p)
        v = slid + (kept - slid.dot(n)) * n
        impulse = mass * (v - q)
        impulse[3] = 0.0
        v[3] = mass
        grid.nodes[I] = v
    return impulse
