"""Adjoint of the walls: of folding ghosts to their mirror nodes, and of unfolding them again.
Unfolding overwrites the nodes that its adjoint depends on; a tape records them for each column."""

from mpm.backend import real_type, ti
from mpm.boundaries.wall_ghosts import column, folded_earlier, mirror, normal4, on_plane, unit
from mpm.scene.grid import BLOCK
from mpm.scene.walls import IS_FREE
from mpm.state.nodes import GridFields

WALL, GHOST, MIRROR = range(3)


@ti.data_oriented
class WallTape:
    """Wall node, ghost and mirror node of every column before it is unfolded, in each of up to `depth` substeps."""

    records = True

    def __init__(self, grid: GridFields, precision: str, depth: int) -> None:
        edge = max(grid.nodes.shape)
        self.nodes = ti.Vector.field(4, real_type(precision), (depth, 6, 3, edge, edge))
        self.meets = ti.field(ti.i32, (depth, 6, edge, edge))  # 1 where the column's material lies at the wall
        self.at = ti.field(ti.i32, ())  # the substep in question, of `depth`

    @ti.func
    def record(self, grid: ti.template(), side, W, axis, inward, stamp, meets):
        """Record the column at wall node W; a ghost in a block that is not active counts as zero."""
        i, j = place_of(W, axis)
        ghost = W - unit(axis) * inward
        self.nodes[self.at[None], side, WALL, i, j] = grid.nodes[W]
        self.meets[self.at[None], side, i, j] = ti.cast(meets, ti.i32)
        self.nodes[self.at[None], side, MIRROR, i, j] = grid.nodes[W + unit(axis) * inward]
        self.nodes[self.at[None], side, GHOST, i, j] = ti.Vector.zero(grid.nodes.dtype, 4)
        if grid.stamp[ghost // BLOCK] == stamp:
            self.nodes[self.at[None], side, GHOST, i, j] = grid.nodes[ghost]


@ti.func
def place_of(W, axis):
    """Return the place (2,) of a wall node on its side."""
    return ti.Vector([W.dot(unit((axis + 1) % 3)), W.dot(unit((axis + 2) % 3))])


@ti.func
def unfold_walls_back(a: ti.template(), step: ti.template()):
    """Adjoint of `unfold_walls`, on the adjoints of node velocities and masses."""
    grid, tape, parameters, table = ti.static((a.fields.grid, a.tape, a.fields.parameters, a.fields.parameters.walls))
    tape.at[None] = step.place
    for w in range(6):  # the last one that was unfolded first
        axis, node, inward, kind, separable = table[w, 0], table[w, 1], table[w, 2], table[w, 3], table[w, 4]
        p = parameters.wall_numbers[w]
        n = normal4(axis, inward, grid.nodes.dtype)
        for active in range(grid.count[None]):
            block = grid.active[active]
            if on_plane(grid, block, axis, node):
                for c, d in ti.ndrange(BLOCK, BLOCK):
                    W = column(grid, block, c, d, axis, node)
                    i, j = place_of(W, axis)
                    if tape.nodes[tape.at[None], w, WALL, i, j][3] != 0:
                        hidden = folded_earlier(grid, table, W, axis)
                        column_back(a, step, ti.Vector([w, i, j]), W, axis, inward, kind, separable, n, hidden, p)


@ti.func
def column_back(a: ti.template(), step: ti.template(), place, W, axis, inward, kind, separable, n, hidden, p):
    """Adjoint of `unfold_column`."""
    tape, bars, conditions = ti.static((a.tape, a.nodes.bars, a.fields.wall_conditions))
    wall = tape.nodes[tape.at[None], place[0], WALL, place[1], place[2]]
    raw = tape.nodes[tape.at[None], place[0], GHOST, place[1], place[2]]
    ghost, partner = W - unit(axis) * inward, W + unit(axis) * inward
    folded = raw[3] < 0 and not hidden
    met, leaves = kind, separable
    if hidden:
        met, leaves = IS_FREE, 1
    image, pair = 0.0 * n, 0.0 * n[0]
    if folded:
        image = mirror(conditions, kind, tape.nodes[tape.at[None], place[0], MIRROR, place[1], place[2]], 1.0, n, p)
        image[3] = -raw[3]
        pair = 2.0 * (-raw[3] * image - raw).dot(n)
    meets = tape.meets[tape.at[None], place[0], place[1], place[2]] > 0
    pair_bar = 0.0 * pair
    if meets:
        wall_bar, push_bar = stop_back(conditions, wall, n, met, leaves, folded, pair, step.kick, p, bars[W])
        bars[W], pair_bar = wall_bar, push_bar
    if raw[3] > 0 and meets:
        ghost_bar, _ = stop_back(ti.static(()), raw, n, IS_FREE, 1, False, 0.0 * pair, step.kick, p, bars[ghost])
        bars[ghost] = ghost_bar
    if folded:
        # the ghost took the image of the mirror's velocity; pair = 2 (mass image - raw) . n
        bar = bars[ghost]
        image_bar = bar - 2.0 * raw[3] * pair_bar * n
        image_bar[3] = 0.0
        mirror_bar = mirror(conditions, kind, image_bar, 0.0, n, p)  # linear but for what it adds to a mass
        mirror_bar[3] = 0.0
        raw_bar = -2.0 * pair_bar * n
        # the ghost's mass also left the mirror's
        raw_bar[3] = bar[3] + 2.0 * pair_bar * image.dot(n) - bars[partner][3]
        bars[partner] = bars[partner] + mirror_bar
        bars[ghost] = raw_bar


@ti.func
def stop_back(conditions: ti.template(), before, n, kind, separable, held, pair, dt, p, bar):
    """Return the adjoints (4,) of velocity and mass, and that of the pair's impulse, of `stop_node`."""
    result, pair_bar = bar, 0.0 * pair
    if before[3] > 0:
        mass = before[3]
        v = before
        v[3] = 0.0
        v_bar = bar
        v_bar[3] = 0.0
        mass_bar = 0.0 * mass
        into = v.dot(n)
        stopped = separable == 0 or held or into < 0
        into_bar, push = v_bar.dot(n), pair
        if stopped:
            into_bar, push = 0.0, pair - mass * into
        slide_bar, push_bar = v_bar - v_bar.dot(n) * n, 0.0 * pair
        for index, condition in ti.static(enumerate(conditions)):
            if kind == index:
                slide_bar, mass_bar, push_bar = condition.slide_back(v - into * n, n, mass, ti.max(push, 0.0), dt, p,
                                                                     slide_bar)
        if push > 0:
            pair_bar = push_bar
            if stopped:
                mass_bar -= into * push_bar
                into_bar -= mass * push_bar
        v_bar = slide_bar + (into_bar - slide_bar.dot(n)) * n
        result = v_bar
        result[3] = bar[3] + mass_bar
    return result, pair_bar


@ti.func
def fold_walls_back(a: ti.template(), step: ti.template()):
    """Adjoint of `fold_walls`, on the adjoints of momenta and masses: a ghost's went to its mirror node, too."""
    grid, tape, parameters = ti.static((a.fields.grid, a.tape, a.fields.parameters))
    table, bars, conditions = ti.static((parameters.walls, a.nodes.bars, a.fields.wall_conditions))
    for back in range(6):
        w = 5 - back
        axis, node, inward, kind = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
        n, p = normal4(axis, inward, grid.nodes.dtype), parameters.wall_numbers[w]
        for active in range(grid.count[None]):
            block = grid.active[active]
            if on_plane(grid, block, axis, node):
                for a, b in ti.ndrange(BLOCK, BLOCK):
                    W = column(grid, block, a, b, axis, node)
                    i, j = place_of(W, axis)
                    k = tape.at[None]
                    folded = tape.nodes[k, w, WALL, i, j][3] != 0 and tape.nodes[k, w, GHOST, i, j][3] < 0
                    if folded and not folded_earlier(grid, table, W, axis):
                        bar = bars[W + unit(axis) * inward]
                        image = mirror(conditions, kind, bar, 0.0, n, p)
                        image[3] = bar[3] + mirror(conditions, kind, 0.0 * n, 1.0, n, p).dot(bar)
                        ghost = W - unit(axis) * inward
                        bars[ghost] = bars[ghost] + image
