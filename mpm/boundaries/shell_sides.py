"""Thin shells on the grid: which side of a shell nodes and grains are on, and the transfers across it.

A grain within reach of a shell keeps the side on which it came (its label) until it leaves the neighbourhood or
passes the rim. Towards nodes on the other side it writes to, and reads from, the second layer of the grid: there its
material meets the shell, and nothing else. Grains with a label are few; the packs leave them out, and they are
transferred one by one from a list.
"""


from mpm.backend import real_type, ti
from mpm.boundaries.coulomb import surface_velocity, tool_axes, tool_origin
from mpm.boundaries.mobile_contact import shared
from mpm.geometry.shell import FAR
from mpm.scene.grid import BLOCK, Grid, activate, clear, first_nodes, mark_place
from mpm.state.ledger import credit, position
from mpm.transfers.particle_grid import weights

CURVATURE = 0.5
"""Cells by which a curved shell may come closer to a stencil's outer nodes than its tangent plane."""
WATCHED = 1.3
"""Cells from the shell within which a grain can come to it in a stride: its own travel and the shell's."""
RECOVERY = 0.2
"""Cells by which the backstop corrects a grain's next position at most."""


class CutFields:
    """Sides of nodes, and the list of the grains with a side, in the order of the packs."""

    def __init__(self, grid: Grid, precision: str, n_particles: int) -> None:
        real = real_type(precision)
        self.side = ti.field(ti.i32, grid.shape)
        """Plus or minus the closest shell's collider index plus one, by side; 0 beyond its rim and far from any."""
        self.shell = ti.field(ti.i32, grid.shape)
        """The closest shell's collider index plus one, beyond the rim too; 0 far from any."""
        self.gap = ti.Vector.field(4, real, grid.shape)
        """Normal towards the positive side and signed distance [m]."""
        self.labelled = ti.field(ti.i32, tuple(n // BLOCK for n in grid.shape))
        """Whether a block's nodes hold labels."""
        self.count = ti.field(ti.i32, ())
        """Grains on the list."""
        self.slot = ti.Vector.field(2, ti.i32, n_particles)
        """Pack and lane."""
        self.base = ti.Vector.field(3, ti.i32, n_particles)
        """First node of the stencil."""
        self.offset = ti.Vector.field(3, real, n_particles)
        """Offset from it in cells."""
        self.mass = ti.field(real, n_particles)
        """[kg]"""
        self.q = [ti.Vector.field(4, real, n_particles) for _ in range(4)]
        """Momentum and mass, and the columns of the affine momentum per cell."""


@ti.func
def label_nodes(scene: ti.template(), motion: ti.template(), s: ti.i32, stamp: ti.i32, corner):
    """Sides of the nodes of active blocks near a shell; activates the second layer of blocks that hold any."""
    before = scene.grid.count[None]
    for n in range(before):
        block = scene.grid.active[n]
        near = 0
        for row, index in ti.static(scene.features.shell_rows):
            middle = position(block * BLOCK, corner, scene.cell) + 0.5 * (BLOCK - 1) * scene.cell
            r = ti.cast(middle, scene.grid.nodes.dtype) - tool_origin(motion, row, s)
            if r.norm() < scene.colliders[index].sdf.radius + 2.6 * scene.cell:
                near = 1
        if near + scene.cuts.labelled[block] > 0:
            scene.cuts.labelled[block] = near
            sides = 0
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in range(BLOCK):
                    sides += label_node(scene, motion, s, near, block * BLOCK + ti.Vector([a, b, c]), corner)
            if sides > 0:
                activate(scene.grid, block + ti.Vector([scene.grid.width // BLOCK, 0, 0]), stamp)
    clear(scene.grid, before, scene.grid.count[None])


@ti.func
def label_node(scene: ti.template(), motion: ti.template(), s: ti.i32, near: ti.i32, I, corner):
    """Store side, shell and gap of a node; returns whether it has a side."""
    closest = ti.cast(FAR, scene.grid.nodes.dtype)
    side, shell = 0, 0
    for row, index in ti.static(scene.features.shell_rows):
        R = tool_axes(motion, row, s)
        r = ti.cast(position(I, corner, scene.cell), scene.grid.nodes.dtype) - tool_origin(motion, row, s)
        n_t, phi, sided = scene.colliders[index].sdf.at(R.transpose() @ r)
        if ti.abs(phi) < closest:
            closest = ti.abs(phi)
            shell = index + 1
            side = sided * shell * (1 if phi >= 0 else -1)
            n = R @ n_t
            scene.cuts.gap[I] = ti.Vector([n[0], n[1], n[2], phi])
    if near == 0:  # of a block that has gone out of reach
        shell, side = 0, 0
    scene.cuts.shell[I] = shell
    scene.cuts.side[I] = side
    return ti.abs(side)


@ti.func
def reaches_across(scene: ti.template(), J):
    """Whether some node of the stencil about node J can lie on the other side of the closest shell."""
    gap = scene.cuts.gap[J]
    return ti.abs(gap[3]) < (ti.abs(gap[0]) + ti.abs(gap[1]) + ti.abs(gap[2]) + CURVATURE) * scene.cell


@ti.func
def label_grains(scene: ti.template(), P: ti.template(), motion: ti.template(), s: ti.i32):
    """Sides of the grains: taken on entering the neighbourhood of a shell, kept inside it."""
    for q in range(P.pack_count[None]):
        near = 0
        for row, index in ti.static(scene.features.shell_rows):
            c_t = tool_origin(motion, row, s)
            d2 = (P.x[0][q] + scene.origin[0] - c_t[0]) ** 2 + (P.x[1][q] + scene.origin[1] - c_t[1]) ** 2 \
                + (P.x[2][q] + scene.origin[2] - c_t[2]) ** 2
            if d2.min() < scene.colliders[index].sdf.radius ** 2:
                near = 1
        if near > 0 or ti.abs(P.side[q]).sum() > 0:
            nodes = first_nodes(scene.grid, P.x, q, 1.0 / scene.cell)[0]
            for l in range(4):
                hot = ti.Vector([ti.cast(l == i, ti.i32) for i in range(4)])
                J = ti.Vector([nodes[d].dot(hot) + 1 for d in range(3)])
                bright = ti.cast(hot, scene.grid.nodes.dtype)
                before = ti.cast(P.side[q].dot(bright), ti.i32)
                x = ti.Vector([P.x[d][q].dot(bright) + scene.origin[d] for d in range(3)])
                side, phi = grain_side(scene, motion, s, J, x)
                if side != 0 and ti.abs(before) == ti.abs(side):
                    side = before
                put(P.gap, q, bright, phi)
                put(P.side, q, bright, ti.cast(side, scene.grid.nodes.dtype))


@ti.func
def grain_side(scene: ti.template(), motion: ti.template(), s: ti.i32, J, x):
    """Side label of a grain at x whose stencil lies about node J, and its signed distance; 0 where nothing is cut."""
    side = 0
    gap = ti.cast(FAR, scene.grid.nodes.dtype)
    if scene.cuts.labelled[J // BLOCK] > 0 and scene.cuts.shell[J] > 0 and reaches_across(scene, J):
        for row, index in ti.static(scene.features.shell_rows):
            if scene.cuts.shell[J] == index + 1:
                y = tool_axes(motion, row, s).transpose() @ (x - tool_origin(motion, row, s))
                _n, phi, sided = scene.colliders[index].sdf.at(y)
                gap = phi
                side = sided * (index + 1) * (1 if phi >= 0 else -1)
    return side, gap


@ti.func
def keep_for_cut(cuts: ti.template(), q, l, node: ti.template(), f: ti.template(), p: ti.template(),
                 mass, Q: ti.template(), fresh):
    """Put lane l of pack q on the list, with what it would have scattered."""
    c = cuts.count[None]
    cuts.count[None] = c + 1
    cuts.slot[c] = ti.Vector([q, l])
    cuts.base[c] = ti.Vector([node[0], node[1], node[2]])
    cuts.offset[c] = ti.Vector([f[0][l], f[1][l], f[2][l]])
    if fresh:  # later substeps of a stride bring none, for the same list
        cuts.mass[c] = mass[l]
    cuts.q[0][c] = ti.Vector([p[0][l], p[1][l], p[2][l], mass[l]])
    for d in ti.static(range(3)):
        cuts.q[1 + d][c] = ti.Vector([Q[d][l], Q[3 + d][l], Q[6 + d][l], 0.0])


@ti.func
def layered(grid: ti.template(), cuts: ti.template(), base, offset: ti.template(), side):
    """The node that a grain with this side exchanges momentum with: in the second layer across its shell."""
    I = base + ti.Vector([offset[0], offset[1], offset[2]])
    if cuts.side[I] == -side:
        I[0] += grid.width
    return I


@ti.func
def lane_of(field: ti.template(), slot):
    """Value of a pack field in a slot (pack, lane)."""
    value = field[slot[0]][0]
    for l in ti.static(range(1, 4)):
        if slot[1] == l:
            value = field[slot[0]][l]
    return value


@ti.func
def side_of(P: ti.template(), slot):
    """Side label of a slot (pack, lane)."""
    return ti.cast(lane_of(P.side, slot), ti.i32)


@ti.func
def scatter_cut(scene: ti.template()):
    """Scatter the grains of the list."""
    for c in range(scene.cuts.count[None]):
        side = side_of(scene.particles, scene.cuts.slot[c])
        f = scene.cuts.offset[c]
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        q_i = scene.cuts.q[0][c]
        for i in ti.static(range(3)):
            q_j = q_i
            for j in ti.static(range(3)):
                q_k = q_j
                for k in ti.static(range(3)):
                    I = layered(scene.grid, scene.cuts, scene.cuts.base[c], (i, j, k), side)
                    scene.grid.nodes[I] = scene.grid.nodes[I] + q_k * (wx[i] * wy[j] * wz[k])
                    q_k = q_k + scene.cuts.q[3][c]
                q_j = q_j + scene.cuts.q[2][c]
            q_i = q_i + scene.cuts.q[1][c]


@ti.func
def gather_cut(scene: ti.template(), motion: ti.template(), s: ti.i32, mobile: ti.template(), dt, corner,
               next_stamp: ti.i32, out: ti.template()):
    """Gather the grains of the list again, from the layers that they scattered to; where dt > 0, they move for that
    time [s], and those that would pass are stopped."""
    for n in range(scene.cuts.count[None]):
        slot = scene.cuts.slot[n]
        side = side_of(scene.particles, slot)
        f = scene.cuts.offset[n]
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        value = ti.Vector.zero(scene.grid.nodes.dtype, 4)
        moment = [value + 0.0, value + 0.0, value + 0.0]
        for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
            p = (wx[i] * wy[j] * wz[k]) * scene.grid.nodes[
                layered(scene.grid, scene.cuts, scene.cuts.base[n], (i, j, k), side)]
            value += p
            for axis, step in ti.static(((0, i), (1, j), (2, k))):
                if ti.static(step > 0):
                    moment[axis] += float(step) * p
        v = ti.Vector([value[0], value[1], value[2]])
        x = (ti.cast(scene.cuts.base[n], scene.grid.nodes.dtype) + f) * scene.cell
        free = v
        if dt > 0:
            v = stop_grain(scene, motion, s, mobile, dt, x, free, scene.cuts.mass[n], side, slot, corner, out)
        hot = ti.Vector([ti.cast(slot[1] == l, scene.grid.nodes.dtype) for l in range(4)])
        gradient = 4.0 / scene.cell
        moved = x + dt * v
        for r in ti.static(range(3)):
            moved[r] = scene.moved(moved[r], r)
            put(scene.particles.v[r], slot[0], hot, v[r])
            for c in ti.static(range(3)):
                put(scene.particles.C[3 * r + c], slot[0], hot, gradient * (moment[c][r] - free[r] * f[c]))
        if dt > 0:
            for r in ti.static(range(3)):
                put(scene.particles.x[r], slot[0], hot, moved[r])
            mark_place(scene.grid, moved, 1.0 / scene.cell, next_stamp)


@ti.func
def put(field: ti.template(), q, hot, value):
    """Store a value in the lane of a pack that is hot."""
    field[q] = field[q] * (1.0 - hot) + value * hot


@ti.func
def stop_grain(scene: ti.template(), motion: ti.template(), s: ti.i32, mobile: ti.template(), dt, x, v, mass, side,
               slot, corner, out: ti.template()):
    """The grain's velocity, corrected where it would carry its cube (half an edge from the centre) into the shell.

    Nodes hold a material back, but not where the shell is, nor each of its grains: this stops the last of them, and
    keeps the material's edge at the shell's face. Credited to the shell.
    """
    result = v
    for row, index in ti.static(scene.features.shell_rows):
        own = ti.cast(1 if side > 0 else -1, scene.grid.nodes.dtype)
        thick = scene.numbers.half_thickness[index]
        if ti.abs(side) == index + 1 and own * lane_of(scene.particles.gap, slot) < thick + WATCHED * scene.cell:
            c_t, R = tool_origin(motion, row, s), tool_axes(motion, row, s)
            r = ti.Vector([x[d] + scene.origin[d] + dt * v[d] - c_t[d] for d in range(3)])
            n_t, phi, sided = scene.colliders[index].sdf.at(R.transpose() @ r)
            size = 0.5 * ti.pow(lane_of(scene.particles.volume, slot), 1.0 / 3.0)
            depth = thick + size - own * phi
            if sided > 0 and depth > 0:
                normal = own * (R @ n_t)
                push = ti.min(depth, RECOVERY * scene.cell) / dt
                slide = v - surface_velocity(motion, row, s, r)
                slide = slide - slide.dot(normal) * normal
                held = ti.min(scene.numbers.frictions[index] * push / slide.norm(1e-12), 1.0)
                dv = push * normal - held * slide
                place = ti.Vector([ti.cast(x[d], ti.f64) for d in range(3)]) + corner
                if ti.static(scene.mobile_place[index] >= 0):
                    dv = shared(scene, mobile, motion, s, index, place, mass, dv)
                credit(out, scene.first_collider_row + index, place, mass * dv)
                result = v + dv
    return result
