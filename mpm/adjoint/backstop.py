"""Adjoint of what stops particles one by one: the last barrier in front of walls and static solids, and the way out of
moving ones."""

from mpm.adjoint.side_layers import gathered_velocity
from mpm.backend import ti
from mpm.state.packs import LANES
from mpm.state.particle_motion import BACKSTOP, RECOVERY, kept_off_walls, plane_at, push_off, push_out

NEARBY = 0.01 * BACKSTOP
"""Cells from the barrier within which a grain may have been stopped by it."""


@ti.func
def stop_back(a: ti.template(), P: ti.template(), B: ti.template(), dt):
    """Adjoint of `stopped_velocity`, on those of velocities and positions of particles that have moved for dt [s].
    The particles hold the positions before the move, the nodes their velocities; leaves in `a.after` the velocities
    before the barrier, and adjoints with which `gather_body_back` finds none for what the barrier has replaced."""
    room = ti.static((BACKSTOP + NEARBY) * a.fields.cell)
    for q in range(P.pack_count[None]):
        depth = 0.0 * P.x[0][q] - a.fields.cell
        for d in ti.static(range(3)):
            low = a.fields.corner + room - a.after.x[d][q]
            depth = ti.max(depth, ti.max(low, a.after.x[d][q] - (a.fields.corner + a.fields.span[d] - room)))
        for l in range(LANES):
            x = ti.Vector([P.x[d][q][l] for d in range(3)])
            owner, n, barrier = 0, 0.0 * x, 0.0 * dt
            if ti.static(len(a.fields.features.static_colliders) > 0):
                owner, n, barrier = plane_at(a.fields, x)
                after = ti.Vector([a.after.x[d][q][l] for d in range(3)])
                if n.dot(after) > barrier + NEARBY * a.fields.cell:
                    owner = 0
            if P.volume[q][l] > 0.0 and (depth[l] > 0.0 or owner > 0):
                v = gathered_velocity(a, P, q, l)
                kept = v
                for d in ti.static(range(3)):
                    kept[d] = kept_off_walls(a.fields, d, x[d], v[d], dt)
                    a.after.v[d][q][l] = v[d]
                if owner > 0 and push_off(n, barrier, x, kept, dt) > 0.0:
                    # the normal part is gone: replaced by (barrier - n . x) / dt, or by nothing where it is beyond that
                    along = 0.0 * dt
                    for d in ti.static(range(3)):
                        along += n[d] * (B.v[d][q][l] + dt * B.x[d][q][l])
                    for d in ti.static(range(3)):
                        if n.dot(x) > barrier:
                            B.x[d][q][l] = B.x[d][q][l] - along / dt * n[d]
                        else:
                            B.v[d][q][l] = B.v[d][q][l] - along * n[d]
                for d in ti.static(range(3)):
                    if kept[d] != v[d] and kept[d] == 0.0:  # stopped where it is
                        B.v[d][q][l] = -dt * B.x[d][q][l]
                    elif kept[d] != v[d]:  # moved to the barrier: kept = (barrier - x) / dt
                        B.x[d][q][l] = -B.v[d][q][l] / dt


@ti.func
def push_out_back(fields: ti.template(), approach, depth, dt, speed_bar, out_bar):
    """Adjoint of `push_out`; return the adjoints of approach and depth."""
    _speed, out = push_out(fields, approach, depth, dt)
    approach_bar, depth_bar, bar = 0.0 * approach, 0.0 * depth, speed_bar
    if out < ti.static(RECOVERY * fields.cell):
        depth_bar += out_bar
        bar -= dt * out_bar
    if -approach >= depth / dt:
        depth_bar += bar / dt
    elif approach < 0:
        approach_bar -= bar
    return approach_bar, depth_bar
