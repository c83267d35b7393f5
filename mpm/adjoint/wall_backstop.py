"""Adjoint of the last barrier in front of walls, for the few grains that it stops."""

from mpm.adjoint.side_layers import gathered_velocity
from mpm.backend import ti
from mpm.state.packs import LANES
from mpm.state.particle_motion import BACKSTOP, kept_off_walls


@ti.func
def stop_at_walls_back(a: ti.template(), P: ti.template(), B: ti.template(), dt):
    """Adjoint of `kept_off_walls`, on those of velocities and positions of particles that have moved for dt [s].
    The particles hold the positions before the move, the nodes their velocities; leaves in `a.after` the velocities
    before the barrier, and adjoints with which `gather_body_back` finds none for what the barrier has replaced."""
    room = ti.static(1.01 * BACKSTOP * a.fields.cell)
    for q in range(P.pack_count[None]):
        depth = 0.0 * P.x[0][q] - a.fields.cell
        for d in ti.static(range(3)):
            low = a.fields.corner + room - a.after.x[d][q]
            depth = ti.max(depth, ti.max(low, a.after.x[d][q] - (a.fields.corner + a.fields.span[d] - room)))
        if depth.max() > 0.0:
            for l in range(LANES):
                if depth[l] > 0.0 and P.volume[q][l] > 0.0:
                    v = gathered_velocity(a, P, q, l)
                    for d in ti.static(range(3)):
                        x = P.x[d][q][l]
                        kept = kept_off_walls(a.fields, d, x, v[d], dt)
                        if kept != v[d]:
                            a.after.v[d][q][l] = v[d]
                            if kept == 0.0:  # stopped where it is
                                B.v[d][q][l] = -dt * B.x[d][q][l]
                            else:  # moved to the barrier: kept = (barrier - x) / dt
                                B.x[d][q][l] = -B.v[d][q][l] / dt
