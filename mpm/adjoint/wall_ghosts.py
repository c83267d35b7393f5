"""Adjoint of the walls: of folding ghosts to their mirror nodes, and of unfolding them again.

Unfolding overwrites the nodes that its adjoint depends on; a tape records them for each column.
"""

from mpm.backend import real_type, ti
from mpm.boundaries.wall_ghosts import (
    SMALLEST_MOMENTUM,
    column,
    folded_earlier,
    mirror,
    normal4,
    on_plane,
    unit,
)
from mpm.scene.grid import BLOCK, Grid
from mpm.scene.walls import FRICTION, ROLLER, SLIP, STICK

WALL, GHOST, MIRROR = range(3)


@ti.data_oriented
class WallTape:
    """Wall node, ghost and mirror node of every column before it is unfolded, in each of up to `depth` substeps."""

    records = True

    def __init__(self, grid: Grid, precision: str, depth: int) -> None:
        edge = max(grid.shape)
        self.nodes = ti.Vector.field(4, real_type(precision), (depth, 6, 3, edge, edge))
        self.at = ti.field(ti.i32, ())
        """The substep in question, of `depth`."""

    @ti.func
    def record(self, grid: ti.template(), side, W, axis, inward, stamp):
        """Record the column at wall node W; a ghost in a block that is not active counts as zero."""
        i, j = place_of(W, axis)
        ghost = W - unit(axis) * inward
        self.nodes[self.at[None], side, WALL, i, j] = grid.nodes[W]
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
    a.tape.at[None] = step.place
    unfold_back(a.fields.grid, a.tape, a.nodes.bars, a.fields.parameters.walls, a.fields.parameters.wall_friction[None])


@ti.func
def unfold_back(grid: ti.template(), tape: ti.template(), bars: ti.template(), table: ti.template(), friction):
    """Reverse the unfolding of all walls, the last one that was unfolded first."""
    for w in range(6):
        axis, node, inward, condition = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
        n = normal4(axis, inward, grid.nodes.dtype)
        for active in range(grid.count[None]):
            block = grid.active[active]
            if on_plane(grid, block, axis, node):
                for a, b in ti.ndrange(BLOCK, BLOCK):
                    W = column(grid, block, a, b, axis, node)
                    i, j = place_of(W, axis)
                    if tape.nodes[tape.at[None], w, WALL, i, j][3] != 0:
                        hidden = folded_earlier(grid, table, W, axis)
                        column_back(bars, tape, ti.Vector([w, i, j]), W, axis, inward, condition, n, hidden, friction)


@ti.func
def column_back(bars: ti.template(), tape: ti.template(), place, W, axis, inward, condition, n, hidden, friction):
    """Adjoint of `unfold_column`."""
    wall = tape.nodes[tape.at[None], place[0], WALL, place[1], place[2]]
    raw = tape.nodes[tape.at[None], place[0], GHOST, place[1], place[2]]
    ghost, partner = W - unit(axis) * inward, W + unit(axis) * inward
    folded = raw[3] < 0 and not hidden
    met, slide = condition, friction
    if hidden:
        met, slide = SLIP, 0.0 * friction
    image, pair = 0.0 * n, 0.0 * friction
    if folded:
        image = mirror(tape.nodes[tape.at[None], place[0], MIRROR, place[1], place[2]], n, condition)
        image[3] = -raw[3]
        pair = 2.0 * (-raw[3] * image - raw).dot(n)
    wall_bar, pair_bar = stop_back(wall, n, met, folded, pair, slide, bars[W])
    bars[W] = wall_bar
    if raw[3] > 0:
        ghost_bar, _ = stop_back(raw, n, SLIP, False, 0.0 * pair, friction, bars[ghost])
        bars[ghost] = ghost_bar
    if folded:
        # the ghost took the image of the mirror's velocity; pair = 2 (mass image - raw) . n
        bar = bars[ghost]
        image_bar = bar - 2.0 * raw[3] * pair_bar * n
        image_bar[3] = 0.0
        mirror_bar = mirror(image_bar, n, condition)
        mirror_bar[3] = 0.0
        raw_bar = -2.0 * pair_bar * n
        # the ghost's mass also left the mirror's
        raw_bar[3] = bar[3] + 2.0 * pair_bar * image.dot(n) - bars[partner][3]
        bars[partner] = bars[partner] + mirror_bar
        bars[ghost] = raw_bar


@ti.func
def stop_back(before, n, condition, held, pair, friction, bar):
    """Return the adjoints (4,) of velocity and mass, and that of the pair's impulse, of `stop_node`."""
    result, pair_bar = bar, 0.0 * pair
    if before[3] > 0:
        mass = before[3]
        v = before
        v[3] = 0.0
        v_bar = bar
        v_bar[3] = 0.0
        mass_bar = 0.0 * mass
        if condition == STICK:
            v_bar = 0.0 * bar
        else:
            into = v.dot(n)
            stopped = condition == ROLLER or held or into < 0
            slide = v - into * n
            slide_bar = v_bar
            into_bar = 0.0 * into
            if not stopped:
                into_bar = v_bar.dot(n)
            slide_bar -= v_bar.dot(n) * n
            if condition == FRICTION:
                push = pair
                if stopped:
                    push = pair - mass * into
                speed = slide.norm(1e-15)
                if push > 0:
                    left = 1.0 - friction * push / ti.max(mass * speed, SMALLEST_MOMENTUM)
                    left_bar = slide.dot(v_bar)
                    slide_bar = ti.max(left, 0.0) * slide_bar
                    if left > 0 and mass * speed > SMALLEST_MOMENTUM:
                        push_bar = -friction * left_bar / (mass * speed)
                        mass_bar = -push_bar * push / mass
                        slide_bar -= push_bar * push / (speed * speed) * slide
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
    """Adjoint of `fold_walls`, on the adjoints of momenta and masses."""
    fold_back(a.fields.grid, a.tape, a.nodes.bars, a.fields.parameters.walls)


@ti.func
def fold_back(grid: ti.template(), tape: ti.template(), bars: ti.template(), table: ti.template()):
    """Reverse the folding of all walls: a ghost's momentum went to its mirror node, too."""
    for back in range(6):
        w = 5 - back
        axis, node, inward, condition = table[w, 0], table[w, 1], table[w, 2], table[w, 3]
        n = normal4(axis, inward, grid.nodes.dtype)
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
                        image = mirror(bar, n, condition)
                        image[3] = bar[3]
                        ghost = W - unit(axis) * inward
                        bars[ghost] = bars[ghost] + image
