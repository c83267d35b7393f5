"""Contact of grid nodes and grains with colliders: Coulomb friction, and a backstop behind it."""

from mpm.backend import ti
from mpm.boundaries.coulomb import coulomb, surface_velocity, tool_axes, tool_origin
from mpm.boundaries.mobile_contact import list_node, shared
from mpm.materials.hencky_strain import keep
from mpm.scene.grid import BLOCK, in_first_layer, mark_place
from mpm.state.ledger import GRAVITY_ROW, add, credit, position

FACE = 0.51
"""Cells in front of a collider's face within which a node counts as on it. Half a cell puts the walls that nodes can
make on average where the face is: the impact on a bar is right to 2 % instead of 11 %. With a whole cell, as for
shells, an elastic bed under a block would settle 9 % too little, as its top layer is held."""

SHELL_FACE = 1.01
"""The same for shells. A free node nearer than a cell to the face lacks the pressure of what would lie beyond it: it
crushes the layer before the face, which then drives the water there upwards, and in 2 s such a circulation takes 5 % of
a gate's thrust. With this the thrust is right to 0.3 %."""

RECOVERY = 0.01
"""Cells by which the backstop brings a grain out in a stride: enough against the slow drift of a fluid towards a face
(1e-3), too little to throw what a scene begins with inside a tool."""


@ti.kernel
def cache_static(node_contact: ti.template(), node_owner: ti.template(), shape: ti.template(), owner: ti.i32,
                 pose: ti.types.ndarray(), corner: ti.types.vector(3, ti.f64), cell: ti.f64):
    """Store normal and distance (n, phi) of a collider that never moves at the nodes inside it or on its face."""
    ti.loop_config(serialize=True)
    for I in ti.grouped(node_contact):
        c = ti.Vector([pose[0], pose[1], pose[2]])
        R = ti.Matrix([[pose[3], pose[4], pose[5]], [pose[6], pose[7], pose[8]], [pose[9], pose[10], pose[11]]])
        n, phi = shape.at(R.transpose() @ (ti.cast(I, ti.f64) * cell + corner - c))
        if phi < FACE * cell and (node_owner[I] == 0 or phi < node_contact[I][3]):
            world = R @ n
            node_contact[I] = ti.Vector([world[0], world[1], world[2], phi])
            node_owner[I] = owner + 1


@ti.func
def update_nodes(grid: ti.template(), scene: ti.template(), motion: ti.template(), s: ti.i32,
                 dt, gravity, origin, cell, out: ti.template(), first, last):
    """Momentum to velocity, gravity, then contact with static and with moving colliders, at the nodes of the active
    blocks first .. last - 1."""
    weight = ti.cast(0.0, ti.f64)
    first_moment = ti.Vector.zero(ti.f64, 3)
    # once a substep: the compiler cannot tell that nodes are not motion
    places = [keep(tool_origin(motion, k, s)) for k in range(len(scene.features.moving_solids))]
    axes = [keep(tool_axes(motion, k, s)) for k in range(len(scene.features.moving_solids))]
    for n in range(first, last):
        block = grid.active[n] * BLOCK
        # summed per block about its corner, in the field's precision: 64 numbers of one size
        mass = ti.cast(0.0, grid.nodes.dtype)
        lever = ti.Vector.zero(grid.nodes.dtype, 3)
        for a, b in ti.ndrange(BLOCK, BLOCK):
            for c in range(BLOCK):
                I = block + ti.Vector([a, b, c])
                q = grid.nodes[I]
                if q[3] > 0:
                    mass += q[3]
                    lever += q[3] * ti.Vector([float(a), float(b), float(c)])
                    v = ti.Vector([q[0], q[1], q[2]]) / q[3] + dt * gravity
                    if ti.static(scene.meets_colliders):
                        v = collide(scene, motion, s, places, axes, I, v, q[3], origin, cell, out)
                    grid.nodes[I] = ti.Vector([v[0], v[1], v[2], q[3]])
        weight += ti.cast(mass, ti.f64)
        first_moment += ti.cast(mass, ti.f64) * position(in_first_layer(grid, block), origin, cell) \
            + cell * ti.cast(lever, ti.f64)
    p = weight * dt * ti.cast(gravity, ti.f64)
    moment = first_moment.cross(ti.cast(gravity, ti.f64)) * dt
    for d in ti.static(range(3)):
        add(out, GRAVITY_ROW, d, p[d])
        add(out, GRAVITY_ROW, 3 + d, moment[d])


@ti.func
def collide(scene: ti.template(), motion: ti.template(), s: ti.i32, places: ti.template(), axes: ti.template(), I,
            before, mass, origin, cell, out: ti.template()):
    """Velocity of a node after contact with static colliders, shells and moving solids, each credited."""
    v = before
    J = in_first_layer(scene.grid, I)
    place = position(J, origin, cell)
    if ti.static(len(scene.features.static_colliders) > 0):
        owner = scene.node_owner[J]
        if owner > 0:
            contact = scene.node_contact[J]
            normal = ti.Vector([contact[0], contact[1], contact[2]])
            new = coulomb(v, v * 0.0, normal, scene.numbers.frictions[owner - 1])
            credit(out, scene.first_collider_row + owner - 1, place, mass * (new - v))
            v = new
    if ti.static(len(scene.features.shells) > 0):
        v = shell_contact(scene, motion, s, I, J, v, mass, place, out)
    for k, index in ti.static(enumerate(scene.features.moving_solids)):
        R = axes[k]
        r = ti.cast(place, scene.grid.nodes.dtype) - places[k]
        if r.norm_sqr() < ti.static((scene.colliders[index].sdf.radius + FACE * scene.cell) ** 2):
            y = R.transpose() @ r
            if not scene.colliders[index].sdf.beyond(y, FACE * scene.cell):
                n_t, phi = scene.colliders[index].sdf.at(y)
                if phi < ti.static(FACE * scene.cell):
                    if ti.static(scene.mobile_place[index] >= 0):
                        list_node(scene.mobiles, scene.mobile_place[index], I, R @ n_t)
                    else:
                        new = coulomb(v, surface_velocity(motion, k, s, r), R @ n_t, scene.numbers.frictions[index])
                        credit(out, scene.first_collider_row + index, place, mass * (new - v))
                        v = new
    return v


@ti.func
def shell_contact(scene: ti.template(), motion: ti.template(), s: ti.i32, I, J, v, mass, place, out: ti.template()):
    """Velocity of a node's material after contact with the closest shell, which gets the impulse.

    The second layer holds what the shell cuts off from the node, the first what is on the node's own side; that meets
    the shell only where the node lies on its face or behind.
    """
    result = v
    side = scene.cuts.side[J]
    if side != 0:
        gap = scene.cuts.gap[J]
        own = I[0] < scene.grid.width
        material = ti.cast(1 if (side > 0) == own else -1, scene.grid.nodes.dtype)
        for row, index in ti.static(scene.features.shell_rows):
            face = scene.numbers.half_thickness[index] + SHELL_FACE * scene.cell
            if ti.abs(side) == index + 1 and material * gap[3] < face:
                normal = material * ti.Vector([gap[0], gap[1], gap[2]])
                if ti.static(scene.mobile_place[index] >= 0):
                    list_node(scene.mobiles, scene.mobile_place[index], I, normal)
                else:
                    r = ti.cast(place, scene.grid.nodes.dtype) - tool_origin(motion, row, s)
                    result = coulomb(v, surface_velocity(motion, row, s, r), normal, scene.numbers.frictions[index])
                    credit(out, scene.first_collider_row + index, place, mass * (result - v))
    return result


@ti.func
def lanes_near(shape: ti.template(), particles: ti.template(), q, R, place, origin):
    """Lanes of a pack, one bit each, whose grain may touch a shape at R, place: most are told to be far at a glance."""
    half = particles.half[q]
    r = [keep(particles.x[d][q] + (origin[d] - place[d])) for d in range(3)]
    y = [keep(R[0, d] * r[0] + R[1, d] * r[1] + R[2, d] * r[2]) for d in range(3)]
    near = 0
    for l in ti.static(range(4)):
        if half[l] > 0 and not shape.beyond(ti.Vector([y[d][l] for d in range(3)]), half[l]):
            near |= 1 << l
    return near


@ti.func
def backstop(particles: ti.template(), grid: ti.template(), scene: ti.template(), motion: ti.template(), s: ti.i32,
             mobile: ti.template(), dt, origin, body: ti.template(), next_stamp: ti.i32, out: ti.template(),
             first, last):
    """Take from every grain whose cube (half an edge from its centre) a moving collider has entered what carries it
    deeper, in the packs first .. last - 1; credit the collider.

    Grid nodes cannot stop the last few grains at a curved or thin wall, and would let a fluid pile up at its face: this
    keeps the material's edge there. No more is taken than the approach and what brings it back gently.
    """
    places = [keep(tool_origin(motion, k, s)) for k in range(len(scene.features.moving_solids))]
    axes = [keep(tool_axes(motion, k, s)) for k in range(len(scene.features.moving_solids))]
    for q in range(first, last):
        for k, index in ti.static(enumerate(scene.features.moving_solids)):
            c_t = places[k]
            d2 = (particles.x[0][q] + origin[0] - c_t[0]) ** 2 + (particles.x[1][q] + origin[1] - c_t[1]) ** 2 \
                + (particles.x[2][q] + origin[2] - c_t[2]) ** 2
            reach = ti.static((scene.colliders[index].sdf.radius + 0.5 * scene.cell) ** 2)
            near = 0
            if d2.min() < reach:
                near = lanes_near(scene.colliders[index].sdf, particles, q, axes[k], c_t, origin)
            while near > 0:
                lane = 0 if near & 1 else (1 if near & 2 else (2 if near & 4 else 3))
                near -= 1 << lane
                x = ti.Vector([particles.x[d][q][lane] for d in range(3)])
                r = ti.Vector([x[d] + origin[d] - c_t[d] for d in range(3)])
                half = particles.half[q][lane]
                y = axes[k].transpose() @ r
                if r.norm_sqr() < reach:
                    n_t, phi = scene.colliders[index].sdf.at(y)
                    if phi < half:
                        v = ti.Vector([particles.v[d][q][lane] for d in range(3)])
                        normal = axes[k] @ n_t
                        approach = (v - surface_velocity(motion, k, s, r)).dot(normal)
                        mass = scene.numbers.densities[body] * particles.volume[q][lane]
                        # the grain acts where it was before the move: x - dt v
                        place = ti.Vector([ti.cast(x[d] - dt * v[d], ti.f64) + origin[d] for d in range(3)])
                        dv = normal * ti.min(ti.max(-approach, 0.0) + RECOVERY * scene.cell / dt, (half - phi) / dt)
                        if ti.static(scene.mobile_place[index] >= 0):
                            dv = shared(scene, mobile, motion, s, index, place, mass, dv)
                        credit(out, scene.first_collider_row + index, place, mass * dv)
                        moved = ti.Vector([scene.moved(x[d] + dt * dv[d], d) for d in range(3)])  # not through a wall
                        for d in ti.static(range(3)):
                            particles.v[d][q][lane] = v[d] + dv[d]
                            particles.x[d][q][lane] = moved[d]
                        mark_place(grid, moved, 1.0 / scene.cell, next_stamp)
