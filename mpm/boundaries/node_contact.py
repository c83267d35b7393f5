"""Grid update, node by node: momentum to velocity, gravity, Coulomb contact with static colliders, shells, solids."""

from mpm.backend import once, ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, coulomb, surface_velocity
from mpm.boundaries.facing import FACE, forget_touching, has_touching_grains, is_at_edge, touched_face, touches_static
from mpm.boundaries.mobile_contact import list_node
from mpm.boundaries.orifice_flow import receding_velocity
from mpm.scene.grid import BLOCK
from mpm.state.ledger import GRAVITY_ROW, add, credit, position
from mpm.state.nodes import in_first_layer, node_of

REACH = FACE + 0.125 + 0.5 * (BLOCK - 1) * 3**0.5 + 0.01
"""Cells from the middle of a block of nodes within which a face can touch one of them in half of a stride, in which a
solid travels an eighth of a cell."""


@ti.kernel
def cache_static_contact(static_contact: ti.template(), shape: ti.template(), owner: ti.i32, is_first: ti.i32,
                         pose: ti.types.ndarray(), origin: ti.types.vector(3, ti.f64), cell: ti.f64,
                         on_gpu: ti.template()):
    """Store normal and distance (n, phi) of a collider that never moves, at nodes inside it or up to 1.2 cells in
    front, as far as particles within half a cell look.
    is_first: what the nodes held before is forgotten."""
    ti.loop_config(serialize=not on_gpu)
    for block in ti.grouped(static_contact.owned):
        if is_first > 0:
            static_contact.owned[block] = 0
    ti.loop_config(serialize=not on_gpu)
    for I in ti.grouped(static_contact.plane):
        if is_first > 0:
            static_contact.owner[I] = 0
        c = ti.Vector([pose[0], pose[1], pose[2]])
        R = ti.Matrix([[pose[3], pose[4], pose[5]], [pose[6], pose[7], pose[8]], [pose[9], pose[10], pose[11]]])
        y = R.transpose() @ (ti.cast(I, ti.f64) * cell + origin - c)
        n, phi = shape.at(y)
        is_closest = static_contact.owner[I] == 0 or phi < static_contact.plane[I][3]
        if phi < 1.2 * cell and is_closest and not is_at_edge(shape, y, n, phi, cell):
            world = R @ n
            static_contact.plane[I] = ti.Vector([world[0], world[1], world[2], phi])
            static_contact.owner[I] = owner + 1
            static_contact.owned[I // BLOCK] = 1


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
            if step.transfer_mass > 0:
                fields.grid.contact[fields.grid.active[n]] = find_contact(fields, step, places, axes, block, origin)
            touches = fields.grid.contact[fields.grid.active[n]]
        # summed per block about its corner, in the field's precision: 64 numbers of one size
        mass = ti.cast(0.0, fields.real)
        lever = ti.Vector.zero(fields.real, 3)
        if ti.static(step.threads > 1):
            I = node_of(fields.grid.active[n], step.thread)
            mass = accelerate(fields, step, I, gravity)
            lever = mass * ti.cast(I - block, fields.real)
            if touches > 0:
                collide(fields, step, places, I, touches, origin)
        else:
            for a, b in ti.ndrange(BLOCK, BLOCK):  # on its own: a short loop, which LLVM makes vectors of
                for c in ti.static(range(BLOCK)):
                    m = accelerate(fields, step, block + ti.Vector([a, b, c]), gravity)
                    mass += m
                    lever += m * ti.Vector([float(a), float(b), float(c)])
            if touches > 0:
                for a, b in ti.ndrange(BLOCK, BLOCK):
                    for c in range(BLOCK):
                        collide(fields, step, places, block + ti.Vector([a, b, c]), touches, origin)
        weight += ti.cast(mass, ti.f64)
        first_moment += ti.cast(mass, ti.f64) * position(in_first_layer(fields.grid, block), origin, fields.cell) \
            + fields.cell * ti.cast(lever, ti.f64)
    if ti.static(step.threads == 1) or weight > 0:
        p = weight * step.kick * ti.cast(gravity, ti.f64)
        moment = first_moment.cross(ti.cast(gravity, ti.f64)) * step.kick
        for d in ti.static(range(3)):
            add(step.out, GRAVITY_ROW, d, p[d])
            add(step.out, GRAVITY_ROW, 3 + d, moment[d])


@ti.func
def accelerate(fields: ti.template(), step: ti.template(), I, gravity):
    """Turn the momentum of a node to the velocity after gravity; return its mass [kg]."""
    q = fields.grid.nodes[I]
    if q[3] > 0:
        v = ti.Vector([q[0], q[1], q[2]]) / q[3] + step.kick * gravity
        fields.grid.nodes[I] = ti.Vector([v[0], v[1], v[2], q[3]])
    return ti.max(q[3], 0.0)  # a ghost that was folded has none of its own


@ti.func
def find_contact(fields: ti.template(), step: ti.template(), places: ti.template(), axes: ti.template(), block, origin):
    """Decide for a stride which nodes of the block that begins at node `block` (3,) touch a solid.
    The others lose their mark in `touching`. Returns what they touch, a bit each as in `may_touch`; where each thread
    has one of the nodes, what they may touch."""
    found = may_touch(fields, places, axes, block, origin)
    if ti.static(step.threads > 1):
        find_contact_of(fields, step, places, axes, node_of(block // BLOCK, step.thread), found, origin)
    elif found > 0:
        touched = 0
        for a, b in ti.ndrange(BLOCK, BLOCK):
            for c in range(BLOCK):
                touched |= find_contact_of(fields, step, places, axes, block + ti.Vector([a, b, c]), found, origin)
        if ti.static(len(fields.features.shells) > 0):  # which have marks of their own
            touched |= found & 1
        found = touched
    return found


@ti.func
def find_contact_of(fields: ti.template(), step: ti.template(), places: ti.template(), axes: ti.template(), I, near,
                    origin):
    """Decide for a stride what node I touches, see `find_contact`; near: what its block may touch.
    Solids count where they are in the middle of the stride."""
    found, has_mass = 0, fields.grid.nodes[I][3] > 0
    if ti.static(len(fields.features.static_colliders) > 0):  # noqa: SIM102  (decided when compiling)
        if near & 1 and has_touching_grains(fields, fields.features.static_row, I):
            contact = fields.static_contact.plane[in_first_layer(fields.grid, I)]
            is_owned = fields.static_contact.owner[in_first_layer(fields.grid, I)] > 0
            if has_mass and is_owned and contact[3] < FACE * fields.cell \
                    and touches_static(fields, I, ti.Vector([contact[0], contact[1], contact[2]])):
                found |= 1
            else:
                forget_touching(fields, fields.features.static_row, I)
    for k, index in ti.static(enumerate(fields.features.moving_solids)):
        if near & ti.static(bit_of(k)) > 0 and has_touching_grains(fields, k, I):
            R = axes[k]
            r = ti.cast(position(in_first_layer(fields.grid, I), origin, fields.cell), fields.real) - places[k]
            r -= half_stride(step) * surface_velocity(step.motion, k, step.row, r)
            face = ti.Vector.zero(fields.real, 4)
            if has_mass and r.norm_sqr() < ti.static((fields.colliders[index].sdf.radius + FACE * fields.cell) ** 2):
                y = R.transpose() @ r
                if not fields.colliders[index].sdf.is_beyond(y, FACE * fields.cell):
                    face = touched_face(fields, I, fields.colliders[index].sdf, R, y)
            if face[0] != 0 or face[1] != 0 or face[2] != 0:
                found |= ti.static(bit_of(k))
                fields.grid.face[k, I[0], I[1], I[2]] = face
            else:
                forget_touching(fields, k, I)
    return found


@ti.func
def half_stride(step: ti.template()):
    """Return the time [s] from the begin of a stride to its middle; 0 for single substeps, whose solids do not wait."""
    return 0.5 * (step.stride - step.dt)


def bit_of(solid: int) -> int:
    """Return the bit of a moving solid in what `may_touch` returns; from the thirtieth on they share one."""
    return 2 << min(solid, 29)


@ti.func
def may_touch(fields: ti.template(), places: ti.template(), axes: ti.template(), first_node, origin):
    """Return what may be at some node of the block that begins at first_node (3,), a bit each.
    The first is for static colliders and shells, then one for each moving solid."""
    corner = in_first_layer(fields.grid, first_node)
    near = 0
    if ti.static(len(fields.features.static_colliders) > 0):
        near |= ti.min(fields.static_contact.owned[corner // BLOCK], 1)
    if ti.static(len(fields.features.shells) > 0):
        near |= ti.min(fields.shells.labelled[corner // BLOCK], 1)
    middle = ti.cast(position(corner, origin, fields.cell) + 0.5 * (BLOCK - 1) * fields.cell, fields.real)
    for k, index in ti.static(enumerate(fields.features.moving_solids)):
        r = middle - places[k]
        ball = ti.static((fields.colliders[index].sdf.radius + REACH * fields.cell) ** 2)
        if r.norm_sqr() < ball:  # noqa: SIM102  (what follows is a look-up)
            if not fields.colliders[index].sdf.is_beyond(axes[k].transpose() @ r, REACH * fields.cell):
                near |= ti.static(bit_of(k))
    return near


@ti.func
def collide(fields: ti.template(), step: ti.template(), places: ti.template(), I, touches, origin):
    """Change a node's velocity by contact with static colliders, shells and moving solids; credit each of them.
    touches: by nodes of its block, see `find_contact`."""
    q, J = fields.grid.nodes[I], in_first_layer(fields.grid, I)
    v, mass, place = ti.Vector([q[0], q[1], q[2]]), q[3], position(J, origin, fields.cell)
    if mass > 0:
        if touches & 1:
            if ti.static(len(fields.features.static_colliders) > 0):  # noqa: SIM102  (decided when compiling)
                if has_touching_grains(fields, fields.features.static_row, I):
                    owner, plane = fields.static_contact.owner[J], fields.static_contact.plane[J]
                    normal = ti.Vector([plane[0], plane[1], plane[2]])
                    v = stop(fields, step, owner - 1, v, 0.0 * v, normal, mass, place)
            if ti.static(len(fields.features.shells) > 0):
                v = collide_with_shell(fields, step, I, J, v, mass, place)
        for k, index in ti.static(enumerate(fields.features.moving_solids)):
            if touches & ti.static(bit_of(k)) > 0 and has_touching_grains(fields, k, I):
                face = fields.grid.face[k, I[0], I[1], I[2]]
                normal = ti.Vector([face[0], face[1], face[2]])
                if ti.static(fields.mobile_place[index] >= 0):
                    list_node(fields.mobile_nodes, fields.mobile_place[index], step.part, I, normal)
                else:
                    r = ti.cast(place, fields.real) - places[k]
                    v = stop(fields, step, index, v, surface_velocity(step.motion, k, step.row, r), normal, mass, place)
        fields.grid.nodes[I] = ti.Vector([v[0], v[1], v[2], mass])


@ti.func
def stop(fields: ti.template(), step: ti.template(), index, v, surface, normal, mass, place):
    """Return the velocity of a node's material after Coulomb contact with a collider, which is credited."""
    new = coulomb(v, surface, normal, fields.parameters.frictions[index])
    credit(step.out, fields.rows.first_collider + index, place, mass * (new - v))
    return new


@ti.func
def collide_with_shell(fields: ti.template(), step: ti.template(), I, J, v, mass, place):
    """Return the velocity of a node's material after contact with the closest shell; credit the shell.
    The second layer holds what the shell separates from the node, the first what is on the node's own side; that meets
    the shell only where the node lies on its face or behind."""
    result = v
    side = fields.shells.side[J]
    if side != 0:
        gap = fields.shells.gap[J]
        own = I[0] < fields.grid.width
        material = ti.cast(1 if (side > 0) == own else -1, fields.real)
        for row, index in ti.static(fields.features.shell_rows):
            face = fields.parameters.half_thickness[index] \
                + fields.colliders[index].sdf.face_cells * fields.cell
            if ti.abs(side) == index + 1 and material * gap[3] < face:
                normal = material * ti.Vector([gap[0], gap[1], gap[2]])
                receding = 0.0 * normal
                if ti.static(len(fields.features.orifices) > 0):
                    receding = receding_velocity(fields, fields.orifices, step, index, place, material)
                if ti.static(fields.mobile_place[index] >= 0):
                    n = list_node(fields.mobile_nodes, fields.mobile_place[index], step.part, I, normal)
                    if ti.static(fields.mobile_nodes.recedes):
                        fields.mobile_nodes.receding[n] = receding
                else:
                    r = ti.cast(place, fields.real) - collider_origin(step.motion, row, step.row)
                    result = stop(fields, step, index, v, surface_velocity(step.motion, row, step.row, r) + receding,
                                  normal, mass, place)
    return result
