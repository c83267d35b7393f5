"""Grid update: momentum to velocity, gravity, and contact with colliders, node by node."""

from mpm.backend import once, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin
from mpm.boundaries.node_contact import collide, may_touch
from mpm.scene.grid import BLOCK
from mpm.state.ledger import GRAVITY_ROW, add, position
from mpm.state.nodes import in_first_layer, node_of


@ti.func
def update_nodes(fields: ti.template(), step: ti.template(), first, last):
    """Phase: momentum to velocity, gravity, contact with colliders, at the nodes of active blocks first .. last - 1."""
    origin, gravity = fields.world_origin(), fields.parameters.gravity[None]
    weight = ti.cast(0.0, ti.f64)
    first_moment = ti.Vector.zero(ti.f64, 3)
    # once a substep: the compiler cannot tell that nodes are not motion
    places = [once(collider_origin(step.motion, k, step.row)) for k in range(len(fields.features.moving_solids))]
    axes = [once(collider_axes(step.motion, k, step.row)) for k in range(len(fields.features.moving_solids))]
    for n in range(first, last):
        block = fields.grid.active[n] * BLOCK
        touches = 0
        if ti.static(len(fields.colliders) > 0):
            touches = may_touch(fields, places, axes, block, origin)
        # summed per block about its corner, in the field's precision: 64 numbers of one size
        mass = ti.cast(0.0, fields.real)
        lever = ti.Vector.zero(fields.real, 3)
        if ti.static(step.threads > 1):
            I = node_of(fields.grid.active[n], step.thread)
            mass = update_node(fields, step, places, axes, I, touches, gravity, origin)
            lever = mass * ti.cast(I - block, fields.real)
        else:
            for a, b in ti.ndrange(BLOCK, BLOCK):
                for c in range(BLOCK):
                    m = update_node(fields, step, places, axes, block + ti.Vector([a, b, c]), touches, gravity, origin)
                    mass += m
                    lever += m * ti.Vector([float(a), float(b), float(c)])
        weight += ti.cast(mass, ti.f64)
        first_moment += ti.cast(mass, ti.f64) * position(in_first_layer(fields.grid, block), origin, fields.cell) \
            + fields.cell * ti.cast(lever, ti.f64)
    if ti.static(step.threads == 1) or weight > 0:
        p = weight * step.dt * ti.cast(gravity, ti.f64)
        moment = first_moment.cross(ti.cast(gravity, ti.f64)) * step.dt
        for d in ti.static(range(3)):
            add(step.out, GRAVITY_ROW, d, p[d])
            add(step.out, GRAVITY_ROW, 3 + d, moment[d])


@ti.func
def update_node(fields: ti.template(), step: ti.template(), places: ti.template(), axes: ti.template(), I, touches,
                gravity, origin):
    """Turn a node's momentum to the velocity after gravity and contact, see `update_nodes`; return its mass [kg]."""
    mass = ti.cast(0.0, fields.real)
    q = fields.grid.nodes[I]
    if q[3] > 0:
        mass = q[3]
        v = ti.Vector([q[0], q[1], q[2]]) / q[3] + step.dt * gravity
        if touches > 0:
            v = collide(fields, step, places, axes, I, v, q[3], origin)
        fields.grid.nodes[I] = ti.Vector([v[0], v[1], v[2], q[3]])
    return mass
