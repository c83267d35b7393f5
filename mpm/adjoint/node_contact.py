"""Adjoint of the contact of nodes with colliders, to the motion of the tool."""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, coulomb, surface_velocity
from mpm.boundaries.node_contact import FACE
from mpm.geometry.rigid_motion import ANGULAR, AXES, LINEAR, ORIGIN
from mpm.scene.grid import BLOCK
from mpm.state.ledger import position


@ti.func
def coulomb_back(v, surface, normal, friction, bar):
    """Return the adjoints of v, surface and normal, from that of the result of `coulomb`."""
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
def surface_back(fields: ti.template(), index: ti.template(), motion: ti.template(), motion_bar: ti.template(),
                 s: ti.i32, R, r, y, n_t, surface_bar, normal_bar, phi_bar):
    """Add the adjoints of a surface's velocity, normal and distance at r from its origin to those of the tool's motion.

    Returns the adjoint of r.
    """
    angular = ti.Vector([motion[0, s, ANGULAR + c] for c in ti.static(range(3))])
    y_bar = fields.colliders[index].sdf.at_back(y, R.transpose() @ normal_bar, phi_bar, fields.real)
    r_bar = surface_bar.cross(angular) + R @ y_bar
    turn_bar = r.cross(surface_bar)
    R_bar = normal_bar.outer_product(n_t) + r.outer_product(y_bar)
    for c in ti.static(range(3)):
        add(motion_bar, s, ORIGIN + c, -r_bar[c])
        add(motion_bar, s, LINEAR + c, surface_bar[c])
        add(motion_bar, s, ANGULAR + c, turn_bar[c])
        for k in ti.static(range(3)):
            add(motion_bar, s, AXES + 3 * c + k, R_bar[c, k])
    return r_bar


@ti.func
def add(table: ti.template(), s: ti.i32, place: ti.template(), value):
    """Add to an entry of a double-precision table."""
    table[s, place] = table[s, place] + ti.cast(value, ti.f64)


@ti.func
def update_nodes_back(a: ti.template(), step: ti.template()):
    """Adjoint of `update_nodes`: from the adjoints of node velocities and masses to those of momenta and masses."""
    gravity, origin = a.fields.parameters.gravity[None], a.fields.world_origin()
    for n in range(a.fields.grid.count[None]):
        block = a.fields.grid.active[n] * BLOCK
        for i, j in ti.ndrange(BLOCK, BLOCK):
            for k in range(BLOCK):
                I = block + ti.Vector([i, j, k])
                q = a.nodes.folded[step.place, I[0], I[1], I[2]]
                if q[3] > 0:
                    bar = a.nodes.bars[I]
                    free = ti.Vector([q[0], q[1], q[2]]) / q[3]
                    v_bar = ti.Vector([bar[0], bar[1], bar[2]])
                    if ti.static(len(a.fields.colliders) > 0):
                        v_bar = collide_back(a.fields, step.motion, step.row, I, free + step.dt * gravity, origin,
                                             v_bar, step.motion_bar)
                    p_bar = v_bar / q[3]
                    a.nodes.bars[I] = ti.Vector([p_bar[0], p_bar[1], p_bar[2], bar[3] - p_bar.dot(free)])


@ti.func
def collide_back(fields: ti.template(), motion: ti.template(), s: ti.i32, I, before, corner, bar,
                 motion_bar: ti.template()):
    """Return the adjoint of a node's velocity before contact with the static colliders and then the tool."""
    v, v_bar = before, bar
    owner = 0
    if ti.static(len(fields.features.static_colliders) > 0):
        owner = fields.static_contact.owner[I]
        if owner > 0:
            contact = fields.static_contact.plane[I]
            normal = ti.Vector([contact[0], contact[1], contact[2]])
            v = coulomb(before, before * 0.0, normal, fields.parameters.frictions[owner - 1])
    for index in ti.static(fields.features.moving_solids):
        r = ti.cast(position(I, corner, fields.cell), fields.real) - collider_origin(motion, 0, s)
        if r.norm_sqr() < ti.static((fields.colliders[index].sdf.radius + FACE * fields.cell) ** 2):
            R = collider_axes(motion, 0, s)
            y = R.transpose() @ r
            if not fields.colliders[index].sdf.is_beyond(y, FACE * fields.cell):
                n_t, phi = fields.colliders[index].sdf.at(y)
                if phi < ti.static(FACE * fields.cell):
                    v_bar, surface_bar, normal_bar = coulomb_back(
                        v, surface_velocity(motion, 0, s, r), R @ n_t, fields.parameters.frictions[index], v_bar)
                    surface_back(fields, index, motion, motion_bar, s, R, r, y, n_t, surface_bar,
                                 normal_bar, 0.0 * phi)
    if ti.static(len(fields.features.static_colliders) > 0):
        v_bar = static_back(fields, I, owner, before, v_bar)
    return v_bar


@ti.func
def static_back(fields: ti.template(), I, owner, before, bar):
    """Return the adjoint of a node's velocity before contact with the static collider that owns it, if one does."""
    v_bar = bar
    if owner > 0:
        contact = fields.static_contact.plane[I]
        normal = ti.Vector([contact[0], contact[1], contact[2]])
        v_bar, _s, _n = coulomb_back(before, before * 0.0, normal, fields.parameters.frictions[owner - 1], bar)
    return v_bar
