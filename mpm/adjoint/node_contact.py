"""Adjoints of contact: of grid nodes and of grains with colliders, to the motion of the tool."""

from mpm.backend import ti
from mpm.boundaries.coulomb import coulomb, surface_velocity, tool_axes, tool_origin
from mpm.boundaries.node_contact import FACE, RECOVERY
from mpm.materials.hencky_strain import keep
from mpm.scene.grid import BLOCK
from mpm.state.ledger import position

PLACE, AXES, LINEAR, ANGULAR = 0, 3, 12, 15
"""Where a row of the motion table holds what."""


@ti.func
def coulomb_back(v, surface, normal, friction, bar):
    """Bars of v, surface and normal by that of what `coulomb` gives."""
    relative = v - surface
    approach = relative.dot(normal)
    v_bar, surface_bar, normal_bar = bar, 0.0 * bar, 0.0 * bar
    if approach < 0:
        slide = relative - approach * normal
        speed = slide.norm(1e-12)
        left = 1.0 + friction * approach / speed
        slide_bar, approach_bar = 0.0 * bar, 0.0 * approach
        if left > 0:
            along = slide.dot(bar)
            approach_bar = friction * along / speed
            slide_bar = left * bar - (approach_bar * approach / (speed * speed)) * slide
        approach_bar -= slide_bar.dot(normal)
        v_bar = slide_bar + approach_bar * normal
        normal_bar = approach_bar * relative - approach * slide_bar
        surface_bar = bar - v_bar
    return v_bar, surface_bar, normal_bar


@ti.func
def surface_back(scene: ti.template(), index: ti.template(), motion: ti.template(), motion_bar: ti.template(),
                 s: ti.i32, R, r, y, n_t, surface_bar, normal_bar, phi_bar):
    """Credit the tool's motion with the bars of its surface's velocity, normal and distance at r from its origin;
    returns the bar of r."""
    angular = ti.Vector([motion[0, s, ANGULAR + c] for c in ti.static(range(3))])
    y_bar = scene.colliders[index].sdf.at_back(y, R.transpose() @ normal_bar, phi_bar, scene.grid.nodes.dtype)
    r_bar = surface_bar.cross(angular) + R @ y_bar
    turn_bar = r.cross(surface_bar)
    R_bar = normal_bar.outer_product(n_t) + r.outer_product(y_bar)
    for c in ti.static(range(3)):
        add(motion_bar, s, PLACE + c, -r_bar[c])
        add(motion_bar, s, LINEAR + c, surface_bar[c])
        add(motion_bar, s, ANGULAR + c, turn_bar[c])
        for k in ti.static(range(3)):
            add(motion_bar, s, AXES + 3 * c + k, R_bar[c, k])
    return r_bar


@ti.func
def add(table: ti.template(), s: ti.i32, place: ti.template(), value):
    """To an entry of a double-precision table."""
    table[s, place] = table[s, place] + ti.cast(value, ti.f64)


@ti.func
def nodes_back(scene: ti.template(), bars: ti.template(), folded: ti.template(), place, motion: ti.template(),
               s: ti.i32, dt, corner, motion_bar: ti.template()):
    """From bars of node velocities and masses to those of momenta and masses; adjoint of `update_nodes`. `folded` holds
    momenta and masses of several substeps, this one's at `place`."""
    gravity = scene.numbers.gravity[None]
    for n in range(scene.grid.count[None]):
        block = scene.grid.active[n] * BLOCK
        for a, b in ti.ndrange(BLOCK, BLOCK):
            for c in range(BLOCK):
                I = block + ti.Vector([a, b, c])
                q = folded[place, I[0], I[1], I[2]]
                if q[3] > 0:
                    bar = bars[I]
                    free = ti.Vector([q[0], q[1], q[2]]) / q[3]
                    v_bar = ti.Vector([bar[0], bar[1], bar[2]])
                    if ti.static(scene.meets_colliders):
                        v_bar = collide_back(scene, motion, s, I, free + dt * gravity, corner, v_bar, motion_bar)
                    p_bar = v_bar / q[3]
                    bars[I] = ti.Vector([p_bar[0], p_bar[1], p_bar[2], bar[3] - p_bar.dot(free)])


@ti.func
def collide_back(scene: ti.template(), motion: ti.template(), s: ti.i32, I, before, corner, bar,
                 motion_bar: ti.template()):
    """Bar of a node's velocity before contact with the static colliders and then the tool."""
    v, v_bar = before, bar
    owner = 0
    if ti.static(len(scene.features.static_colliders) > 0):
        owner = scene.node_owner[I]
        if owner > 0:
            contact = scene.node_contact[I]
            normal = ti.Vector([contact[0], contact[1], contact[2]])
            v = coulomb(before, before * 0.0, normal, scene.numbers.frictions[owner - 1])
    for index in ti.static(scene.features.moving_solids):
        r = ti.cast(position(I, corner, scene.cell), scene.grid.nodes.dtype) - tool_origin(motion, 0, s)
        if r.norm_sqr() < ti.static((scene.colliders[index].sdf.radius + FACE * scene.cell) ** 2):
            R = tool_axes(motion, 0, s)
            y = R.transpose() @ r
            if not scene.colliders[index].sdf.beyond(y, FACE * scene.cell):
                n_t, phi = scene.colliders[index].sdf.at(y)
                if phi < ti.static(FACE * scene.cell):
                    v_bar, surface_bar, normal_bar = coulomb_back(
                        v, surface_velocity(motion, 0, s, r), R @ n_t, scene.numbers.frictions[index], v_bar)
                    surface_back(scene, index, motion, motion_bar, s, R, r, y, n_t, surface_bar,
                                 normal_bar, 0.0 * phi)
    if ti.static(len(scene.features.static_colliders) > 0):
        v_bar = static_back(scene, I, owner, before, v_bar)
    return v_bar


@ti.func
def static_back(scene: ti.template(), I, owner, before, bar):
    """Bar of a node's velocity before contact with a static collider, if one owns the node."""
    v_bar = bar
    if owner > 0:
        contact = scene.node_contact[I]
        normal = ti.Vector([contact[0], contact[1], contact[2]])
        v_bar, _s, _n = coulomb_back(before, before * 0.0, normal, scene.numbers.frictions[owner - 1], bar)
    return v_bar


@ti.func
def backstop_back(scene: ti.template(), P: ti.template(), B: ti.template(), after: ti.template(), index: ti.template(),
                  body: ti.template(), motion: ti.template(), s: ti.i32, dt, motion_bar: ti.template()):
    """Adjoint of `backstop` on the bars of velocity and position, of grains that moved for dt [s]. P holds positions
    before the move, the nodes their velocities; leaves in `after` what grains near the tool had before the backstop."""
    c_t, R = keep(tool_origin(motion, 0, s)), keep(tool_axes(motion, 0, s))
    reach = ti.static((scene.colliders[index].sdf.radius + 0.5 * scene.cell) ** 2)
    for q in range(P.ranges[body][0], P.ranges[body][1]):
        d2 = (after.x[0][q] + scene.origin[0] - c_t[0]) ** 2 + (after.x[1][q] + scene.origin[1] - c_t[1]) ** 2 \
            + (after.x[2][q] + scene.origin[2] - c_t[2]) ** 2
        # the backstop moves a grain by a small part of a cell
        if d2.min() < ti.static((scene.colliders[index].sdf.radius + 0.6 * scene.cell) ** 2):
            v, _B, _f = scene.gathered(P, q)
            for d in ti.static(range(3)):
                after.v[d][q] = v[d]
                after.x[d][q] = scene.moved(P.x[d][q] + dt * v[d], d)
            for lane in range(4):
                hot = ti.Vector([ti.cast(lane == l, scene.grid.nodes.dtype) for l in range(4)])
                r = ti.Vector([after.x[d][q].dot(hot) + scene.origin[d] - c_t[d] for d in range(3)])
                half = P.half[q].dot(hot)
                y = R.transpose() @ r
                if r.norm_sqr() < reach and half > 0 and not scene.colliders[index].sdf.beyond(y, half):
                    n_t, phi = scene.colliders[index].sdf.at(y)
                    if phi < half:
                        v_l = ti.Vector([v[d].dot(hot) for d in range(3)])
                        v_bar = ti.Vector([B.v[d][q].dot(hot) for d in range(3)])
                        x_bar = ti.Vector([B.x[d][q].dot(hot) for d in range(3)])
                        normal = R @ n_t
                        relative = v_l - surface_velocity(motion, 0, s, r)
                        approach = relative.dot(normal)
                        stopped = ti.max(-approach, 0.0) + RECOVERY * scene.cell / dt
                        push_bar = (v_bar + dt * x_bar).dot(normal)
                        normal_bar = ti.min(stopped, (half - phi) / dt) * (v_bar + dt * x_bar)
                        approach_bar, phi_bar = 0.0 * push_bar, 0.0 * push_bar
                        if stopped >= (half - phi) / dt:
                            phi_bar = -push_bar / dt
                        elif approach < 0:
                            approach_bar = -push_bar
                        normal_bar += approach_bar * relative
                        relative_bar = approach_bar * normal
                        r_bar = surface_back(scene, index, motion, motion_bar, s, R, r, y, n_t,
                                             -relative_bar, normal_bar, phi_bar)
                        for d in ti.static(range(3)):
                            B.v[d][q] = B.v[d][q] + relative_bar[d] * hot
                            B.x[d][q] = B.x[d][q] + r_bar[d] * hot
