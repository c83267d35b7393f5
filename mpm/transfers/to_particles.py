"""Grid to particle: velocity and affine velocity, the particles' move, and the active blocks of the next substep."""

from mpm.backend import is_concurrent, is_shared, once, ti
from mpm.state.active_blocks import list_row
from mpm.state.ledger import add
from mpm.state.nodes import first_nodes
from mpm.state.packs import LANES, active_lanes, lowest_bit, pack_at
from mpm.state.particle_motion import drift_after, mark_active_lanes, move_pack, stop_pack
from mpm.state.particles import SPEED_LIMIT
from mpm.state.sleepers import sleeping_lanes
from mpm.state.stencil import NodeValues, SingleLayer, gather, lane_weights, moments, weights


@ti.func
def start_block_list(fields: ti.template(), step: ti.template(), first, last):
    """Phase: empty the list of active blocks before particles that move list those of the next substep."""
    if step.span > 0:
        fields.grid.count[None] = 0
    fields.particles.fastest[None] = 0.0
    fields.particles.squares[None] = 0.0


@ti.func
def gather_packs(fields: ti.template(), step: ti.template(), first, last):
    """Phase: gather velocities of packs first .. last - 1; at the end of a stride, move the particles."""
    gather_and_move(fields, fields.particles, step, drift_after(fields, step), first, last)
    if ti.static(not fields.features.sleep):  # there, padding lanes always sleep
        for body in range(fields.parameters.densities.shape[0]):
            ends = fields.particles.range_table[body]
            if first < ends[1] and ends[1] <= last:
                zero_padding_lanes(fields.particles, ends[1] - 1, ends[2])


@ti.func
def gather_and_move(fields: ti.template(), P: ti.template(), step: ti.template(), dt, first, last):
    """Gather velocity and affine velocity of packs first .. last - 1; where dt > 0, move them for that time [s].
    The blocks that moved particles reach are activated for the next substep."""
    last_key = -1
    fastest = ti.Vector.zero(fields.real, LANES)
    squares = fastest
    for place in range(first, last):
        q = pack_at(fields, place)
        v, B, f, masses, around = gather_pack(fields, P, q)
        gradient = 4.0 / fields.cell
        for r in ti.static(range(3)):
            for c in ti.static(range(3)):
                P.C[3 * r + c][q] = gradient * (B[3 * r + c] - v[r] * f[c])
        if ti.static(len(fields.wall_conditions) > 0 or len(fields.features.static_colliders) > 0) and dt > 0:
            stop_pack(fields, P, step, q, v, dt)
        for r in ti.static(range(3)):
            P.v[r][q] = v[r]
        if dt > 0:
            if ti.static(fields.features.density_state):
                note_density(fields, P, q, around)
            for r in ti.static(range(3)):
                displacement = dt * v[r]
                if ti.static(len(P.remainder) > 0 and len(fields.features.shells) > 0):
                    # `move_listed` moves the others, from where they are now
                    displacement = ti.select(P.side[q] == 0.0, displacement, 0.0 * displacement)
                move_pack(fields, P, q, r, displacement)
            last_key = mark_active_lanes(fields, P, q, last_key, step.stamp + step.span)
        v2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        fastest = ti.max(fastest, v2)
        squares += v2 + masses
    note_speeds(P, fastest.max(), squares.sum())


@ti.func
def note_density(fields: ti.template(), P: ti.template(), q, around):
    """Note the mass [kg] around the lanes of pack q that are updated."""
    if ti.static(fields.features.sleep):
        P.noted[q] = ti.select(sleeping_lanes(fields, q) > 0, P.noted[q], around)
    else:
        P.noted[q] = around


@ti.func
def note_speeds(P: ti.template(), fastest, squares):
    """Note the largest squared speed and the sum of squared speeds of some particles."""
    if ti.static(is_concurrent()):
        ti.atomic_max(P.fastest[None], fastest)
        ti.atomic_add(P.squares[None], squares)
    else:
        P.fastest[None] = ti.max(P.fastest[None], fastest)
        P.squares[None] = P.squares[None] + squares


@ti.func
def check_speeds(fields: ti.template(), step: ti.template(), first, last):
    """Phase: halt the launch where a particle is not finite, or would travel more than SPEED_LIMIT cells a substep."""
    limit = ti.static(SPEED_LIMIT * fields.cell)
    fastest, squares = fields.particles.fastest[None], fields.particles.squares[None]
    is_sound = fastest * step.dt * step.dt <= limit * limit and squares - squares == 0.0
    if not is_sound and fields.particles.halted[None] == 0:
        fields.particles.halted[None] = step.row + 1
        if ti.static(is_shared()):  # there, the host learns it at the end of the launch
            add(step.out, fields.rows.status, 2, ti.cast(step.row + 1, ti.f64))


@ti.func
def gather_pack(fields: ti.template(), P: ti.template(), q):
    """Return velocity (three packs) at pack q, its moments about the first node, per cell (nine), the offsets, what the
    nodes' masses and their moments add up to, of use only where one is not finite, and these masses [kg] alone."""
    base, f = first_nodes(fields.grid, P.x, q, 1.0 / fields.cell)
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    # four numbers a node, the mass too, stored together and all used: only then LLVM makes them one vector
    rows = [once(ti.Matrix.zero(fields.real, LANES, 4)) for _ in range(4)]
    left = active_lanes(fields, q)
    while left > 0:  # over a counted loop LLVM would make vectors of four lanes, which are loaded number by number
        l = lowest_bit(left)
        left -= 1 << l
        w = [lane_weights(wx, l), lane_weights(wy, l), lane_weights(wz, l)]
        sums = gather(ti.static(NodeValues(fields.grid.nodes, SingleLayer())), [once(base[d][l]) for d in range(3)],
                      fields.real, w, [moments(w[0]), moments(w[1]), moments(w[2])], 1)
        for i, c in ti.static(ti.ndrange(4, 4)):
            rows[i][l, c] = sums[i][c]
    packs = [[once(ti.Vector([row[l, c] for l in range(LANES)])) for row in rows] for c in range(4)]
    return ([each[0] for each in packs[:3]], [each[i] for each in packs[:3] for i in range(1, 4)], f,
            once(packs[3][0] + packs[3][1] + packs[3][2] + packs[3][3]), packs[3][0])


@ti.func
def zero_padding_lanes(P: ti.template(), q, filled):
    """Zero the padding lanes of the last pack of a body; otherwise they gather from massless nodes and diverge."""
    for l in ti.static(range(1, LANES)):
        if l >= filled:
            for d in ti.static(range(3)):
                P.v[d][q][l] = 0.0
            for i in ti.static(range(9)):
                P.C[i][q][l] = 0.0


@ti.func
def list_blocks(fields: ti.template(), step: ti.template(), first, last):
    """Phase: where mass is transferred, list the active blocks that are in rows first .. last - 1 of all blocks."""
    if step.transfer_mass > 0:
        for row in range(first, last):
            list_row(fields.grid, row, step.stamp)
