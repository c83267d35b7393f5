"""The sleep check between two strides: which particles fall asleep, and which wake."""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.geometry.rigid_motion import LINEAR
from mpm.geometry.shell import SHELL_FACE
from mpm.motion.mobile_motion import TWIST
from mpm.scene.grid import BLOCK, GHOST
from mpm.state.active_blocks import activate_and_list, mark_place
from mpm.state.ledger import add, position
from mpm.state.nodes import first_nodes, node_of
from mpm.state.packs import LANES
from mpm.state.sleepers import AHEAD, ALL_LANES, CALM_TIME, CREEP, STRAIN, WAKE_DISPLACEMENT, place_of_node
from mpm.state.stencil import weights
from mpm.stepping.sleep_contributions import apply_changes

SIDE_CELLS = 8
"""Cells from a periodic side within which no particle sleeps: what sleeps has no images."""
STENCIL = BLOCK + 2  # nodes along each axis that the stencils of a block's particles can reach
HALF_DIAGONAL = 0.5 * (STENCIL - 1) * 3**0.5  # cells from the middle of those nodes to the farthest
SURPRISE = 2.0
"""How many times as far as at its present speed a mobile collider may get until the next check."""


@ti.func
def check_sleep(fields: ti.template(), launch: ti.template(), s, rows, elapsed):
    """Let particles fall asleep and wake, before substep s of a launch.
    rows: substeps until the next check. elapsed: [s] since the last one."""
    stamp = launch.stamp + s
    fields.sleepers.check[None] = fields.sleepers.check[None] + 1
    if rows > 0:
        fields.sleepers.search[None] = fields.sleepers.search[None] + 1
        find_near_blocks(fields, launch, launch.first_row + s, rows, stamp)
    fallen, woken = 0, 0
    if elapsed > 0:  # else the last launch has ended with a check
        fallen = find_falling_asleep(fields, fields.particles, elapsed, launch.out)
    if fields.sleepers.is_disturbed[None] > 0:
        woken = wake_disturbed(fields, fields.particles, stamp)
        fields.sleepers.is_disturbed[None] = 0
    if fallen + woken + fields.sleepers.are_sums_stale[None] > 0:
        apply_changes(fields)
        fields.sleepers.are_sums_stale[None] = 0


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
                            for n in range(BLOCK**3):
                                place = place_of_node(fields, node_of(block, n))
                                fields.sleepers.disturbed_at[place] = fields.sleepers.check[None]
                            fields.sleepers.is_disturbed[None] = 1


@ti.func
def find_falling_asleep(fields: ti.template(), P: ti.template(), elapsed, out: ti.template()):
    """Count the time for which particles have been calm; return how many packs have a lane that falls asleep."""
    calm_time = ti.cast(fields.sleepers.limits[CALM_TIME], fields.real)
    creep = ti.cast(fields.sleepers.limits[CREEP], fields.real)
    strain = ti.cast(fields.sleepers.limits[STRAIN], fields.real)
    fallen = 0
    for body in range(fields.parameters.densities.shape[0]):
        ends = fields.sleepers.ranges[body]
        for place in range(ends[0], ends[1]):
            q = fields.sleepers.awake[place]
            here = volume_strain(fields, P, q)
            moved = (P.x[0][q] - P.rest_place[0][q]) ** 2 + (P.x[1][q] - P.rest_place[1][q]) ** 2 \
                + (P.x[2][q] - P.rest_place[2][q]) ** 2
            calm = ti.select(moved <= creep * creep, 1, 0)
            calm *= ti.select(ti.abs(here - P.rest_place[3][q]) <= strain, 1, 0)
            rest = ti.select(calm > 0, P.rest[q] + elapsed, 0.0 * here)
            asleep = fields.sleepers.lanes_asleep[q]
            bits = 0
            for l in ti.static(range(LANES)):
                if (asleep >> l) & 1 == 0 and rest[l] >= calm_time:
                    bits |= 1 << l
            if bits != 0:
                bits &= lanes_that_may_sleep(fields, P, q)
            for l in ti.static(range(LANES)):
                if (asleep >> l) & 1 == 0:
                    if rest[l] >= calm_time and (bits >> l) & 1 == 0:
                        rest[l] = 0.0
                    if calm[l] == 0 or rest[l] == 0.0:
                        P.rest_place[3][q][l] = here[l]
                        for d in ti.static(range(3)):
                            P.rest_place[d][q][l] = P.x[d][q][l]
                    P.rest[q][l] = rest[l]
            if bits != 0:
                put_to_sleep(fields, P, q, bits, fields.parameters.densities[body], out)
                fields.sleepers.lanes_asleep[q] = asleep | bits
                fallen += 1
    return fallen


@ti.func
def volume_strain(fields: ti.template(), P: ti.template(), q):
    """Return a measure of the volume change of pack q's particles."""
    strain = 0.0 * P.x[0][q]
    if ti.static(fields.features.tensor_state):
        strain = P.e[0][q] + P.e[1][q] + P.e[2][q]
    if ti.static(fields.features.volume_state):
        strain = strain + P.j[q]
    return strain


@ti.func
def lanes_that_may_sleep(fields: ti.template(), P: ti.template(), q):
    """Return the lanes of pack q, one bit each, that no moving collider, shell or periodic side keeps awake."""
    base = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)[0]
    bits = 0
    for l in ti.static(range(LANES)):
        node = ti.Vector([base[d][l] for d in range(3)])
        free = fields.sleepers.near[node // BLOCK] != fields.sleepers.search[None]
        if ti.static(len(fields.features.shells) > 0):
            free = free and P.side[q][l] == 0
        for d in ti.static(range(3)):
            if ti.static(fields.features.periodic[d]):
                free = free and node[d] >= GHOST + SIDE_CELLS and node[d] + 2 <= GHOST + fields.cells[d] - SIDE_CELLS
        if free:
            bits |= 1 << l
    return bits


@ti.func
def put_to_sleep(fields: ti.template(), P: ti.template(), q, bits, density, out: ti.template()):
    """Stop lanes of pack q; the ledger's row `asleep` takes their momentum up."""
    spread = 0.25 * fields.cell * fields.cell
    origin = fields.world_origin()
    for l in ti.static(range(LANES)):
        if (bits >> l) & 1:
            m = ti.cast(density * P.volume[q][l], ti.f64)
            x = ti.Vector([ti.cast(P.x[d][q][l], ti.f64) for d in range(3)]) + origin
            p = m * ti.Vector([ti.cast(P.v[d][q][l], ti.f64) for d in range(3)])
            spin = ti.Vector([P.C[7][q][l] - P.C[5][q][l], P.C[2][q][l] - P.C[6][q][l], P.C[3][q][l] - P.C[1][q][l]])
            turning = x.cross(p) + m * spread * ti.cast(spin, ti.f64)
            for d in ti.static(range(3)):
                add(out, fields.rows.asleep, d, -p[d])
                add(out, fields.rows.asleep, 3 + d, -turning[d])
                P.v[d][q][l] = 0.0
                P.rest_place[d][q][l] = 0.0
            for i in ti.static(range(9)):
                P.C[i][q][l] = 0.0


@ti.func
def wake_disturbed(fields: ti.template(), P: ti.template(), stamp: ti.i32):
    """Wake sleepers in blocks near a collider, and those whose nodes have moved away; return how many packs.
    While a particle sleeps its `rest_place` is the displacement of its nodes since it fell asleep, so that the error of
    its stress stays bounded: vibration averages to zero and does not wake it; sustained flow does, however slow."""
    check, woken = fields.sleepers.check[None], 0
    limit = ti.cast(fields.sleepers.limits[WAKE_DISPLACEMENT], fields.real)
    for q in range(P.pack_count[None]):
        asleep, disturbed = fields.sleepers.lanes_asleep[q], 0
        if asleep != 0:
            for l in ti.static(range(LANES)):
                if fields.sleepers.disturbed_at[fields.sleepers.home[q][l]] == check:
                    disturbed |= asleep & (1 << l)
        if disturbed != 0:
            base, f = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)
            bits = 0
            for l in range(LANES):
                if (disturbed >> l) & 1 and P.volume[q][l] > 0.0:
                    node = ti.Vector([base[d][l] for d in range(3)])
                    wakes = fields.sleepers.near[node // BLOCK] == fields.sleepers.search[None]
                    if not wakes:
                        u = displacement(fields, node, [f[0][l], f[1][l], f[2][l]], check)
                        u += ti.Vector([P.rest_place[d][q][l] for d in range(3)])
                        wakes = u.norm_sqr() > limit * limit
                        for d in ti.static(range(3)):
                            P.rest_place[d][q][l] = u[d]
                    if wakes:
                        bits |= 1 << l
            if bits != 0:
                wake_lanes(fields, P, q, bits, stamp)
                woken += 1
    return woken


@ti.func
def wake_lanes(fields: ti.template(), P: ti.template(), q, bits, stamp: ti.i32):
    """Wake lanes of pack q, and activate the blocks of their stencils."""
    fields.sleepers.lanes_asleep[q] = fields.sleepers.lanes_asleep[q] & (ALL_LANES - bits)
    fields.sleepers.version[q] = fields.sleepers.version[q] + 1
    here = volume_strain(fields, P, q)
    for l in ti.static(range(LANES)):
        if (bits >> l) & 1:
            P.rest[q][l] = 0.0
            P.rest_place[3][q][l] = here[l]
            for d in ti.static(range(3)):
                P.rest_place[d][q][l] = P.x[d][q][l]
            mark_place(fields.grid, ti.Vector([P.x[d][q][l] for d in range(3)]), 1.0 / fields.cell, stamp)


@ti.func
def displacement(fields: ti.template(), node, f: ti.template(), check):
    """Return the mean displacement [m] (3,) since the last check of the active nodes of a stencil, by their weights."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    total, weight = ti.Vector.zero(fields.real, 3), 1e-6
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            for k in ti.static(range(3)):
                I = node + ti.Vector([i, j, k])
                if fields.sleepers.window[I] == check:
                    w = wx[i] * wy[j] * wz[k]
                    total += w * fields.sleepers.path[I]
                    weight += w
    return total / weight


@ti.func
def activate_sides(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where mass is transferred, activate both blocks in which a wall's plane and ghosts lie.
    Where one is active and sleepers reach the other."""
    n = 0
    while n < fields.grid.count[None] * step.transfer_mass:
        block = fields.grid.active[n]
        for d in ti.static(range(3)):
            last = ti.static(GHOST + fields.cells[d])  # the wall's node; its mirror node is below, its ghost above
            low, high = ti.static((last - 1) // BLOCK), ti.static((last + 1) // BLOCK)
            if ti.static(low != high and not fields.features.periodic[d]):
                other = block
                if block[d] == low:
                    other[d] = high
                elif block[d] == high:
                    other[d] = low
                if block[0] < fields.grid.width // BLOCK and fields.sleepers.stencil_count[other] > 0:
                    activate_and_list(fields.grid, other, step.stamp)
        n += 1
