"""Colliders that contact moves: their twist and the velocities of the nodes they touch are solved for together.
In every substep the nodes inside a mobile collider are listed instead of being stopped one by one. With p(V) the
impulses that Coulomb contact with a collider of twist V gives the nodes, and W its mobility, V = V* - W sum G^T p(V) is
solved by Newton's method in six unknowns, whatever the number of nodes: no mass ratio is too large for it. The same
impulses then act on both, so that what the grains gain the collider loses, to rounding. (The reduction of a body's
contacts to six unknowns follows Batty et al. 2007, ACM TOG 26(3):100, and Daviet and Bertails-Descoubes 2016, ACM TOG
35(4):102.)"""

from mpm.backend import ti
from mpm.boundaries.coulomb import coulomb, coulomb_slope
from mpm.motion.mobile_motion import (
    CENTRE,
    RESIDUAL,
    RESPONSE,
    TWIST,
    apply_impulse,
    change_of_twist,
    move_colliders,
    read_vector,
    write_velocity,
)
from mpm.state.contact_fields import sort_by_part, take_place
from mpm.state.ledger import add, position
from mpm.state.nodes import in_first_layer

MAX_PASSES = 100
"""Sweeps over the listed nodes in one solve. Two or three are the rule; a body a hundred times lighter than the grains
that it lands on can take more than 80, most of them to shorten steps."""
SMALL_CHANGE = 1e-3
"""Change of a twist [m/s] by contact below which the residual is taken relative to this, as it does not matter then."""


@ti.func
def list_node(lists: ti.template(), b: ti.template(), part, I, normal):
    """Put a node that a part of the list of blocks holds on a collider's list; return its place there."""
    place = lists.first[b] + take_place(lists.count, b)
    lists.node[place] = I
    lists.normal[place] = normal
    if ti.static(lists.sorts):
        lists.part[place] = part
    if ti.static(lists.recedes):
        lists.receding[place] = 0.0 * normal
    return place


@ti.func
def surface_at(fields: ti.template(), linear, angular, r, n):
    """Return the velocity [m/s] of a collider's face at the node in a place of the lists, r [m] from its centre."""
    surface = ti.cast(linear + angular.cross(r), fields.real)
    if ti.static(fields.mobile_nodes.recedes):
        surface += fields.mobile_nodes.receding[n]
    return surface


@ti.func
def place_in_order(lists: ti.template(), n):
    """Return the place on the lists of what comes n-th."""
    place = n
    if ti.static(lists.sorts):
        place = lists.order[n]
    return place


@ti.func
def contact_compliance(fields: ti.template(), mobile: ti.template(), b: ti.template(), place, direction):
    """Return the velocity [m/s per N s] of a collider's surface at a place by a unit impulse along a direction."""
    size = ti.static(6 * len(fields.features.mobile))
    n = ti.cast(direction, ti.f64)
    arm = (place - read_vector(mobile, b, CENTRE)).cross(n)
    P = [n[0], n[1], n[2], arm[0], arm[1], arm[2]]
    total = ti.cast(0.0, ti.f64)
    for i in ti.static(range(6)):
        for j in ti.static(range(6)):
            total += P[i] * mobile[b, RESPONSE + i * size + 6 * b + j] * P[j]
    return total


@ti.func
def lever_of(fields: ti.template(), mobile: ti.template(), b: ti.template(), I, corner):
    """Return the vector [m] from the collider's centre to a node of either layer."""
    return position(in_first_layer(fields.grid, I), corner, fields.cell) - read_vector(mobile, b, CENTRE)


@ti.func
def wait(step: ti.template()):
    """Wait for the other threads of a team: all threads of a GPU that solve for one collider together."""
    if ti.static(step.threads > 1):
        ti.simt.block.sync()


@ti.func
def sum_over_team(fields: ti.template(), step: ti.template(), force, torque):
    """Return an impulse, and torque, summed over the threads of a team."""
    if ti.static(step.threads > 1):
        for d in ti.static(range(3)):
            ti.atomic_add(fields.mobile_nodes.impulse[d], force[d])
            ti.atomic_add(fields.mobile_nodes.impulse[3 + d], torque[d])
        wait(step)
        for d in ti.static(range(3)):
            force[d], torque[d] = fields.mobile_nodes.impulse[d], fields.mobile_nodes.impulse[3 + d]
    return force, torque


@ti.func
def clear_sums(fields: ti.template(), step: ti.template()):
    """Zero what a team sums up, once all its threads have read it."""
    if ti.static(step.threads > 1):
        wait(step)
        if step.thread == 0:
            for i in range(6):
                fields.mobile_nodes.impulse[i] = 0.0
                for j in range(6):
                    fields.mobile_nodes.slope[i, j] = 0.0
        wait(step)


@ti.func
def reaction(fields: ti.template(), step: ti.template(), b: ti.template(), index: ti.template(), V, corner):
    """Return the impulse of the listed nodes on a collider of twist V; store its negative derivative in `slope`."""
    clear_sums(fields, step)
    force, torque = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    A, B = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    C, D = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    linear, angular = ti.Vector([V[0], V[1], V[2]]), ti.Vector([V[3], V[4], V[5]])
    for turn in range((fields.mobile_nodes.count[b] - step.thread + step.threads - 1) // step.threads):
        n = place_in_order(fields.mobile_nodes, fields.mobile_nodes.first[b] + step.threads * turn + step.thread)
        I = fields.mobile_nodes.node[n]
        q = fields.grid.nodes[I]
        r = lever_of(fields, step.mobile, b, I, corner)
        surface = surface_at(fields, linear, angular, r, n)
        v = ti.Vector([q[0], q[1], q[2]])
        change = coulomb(v, surface, fields.mobile_nodes.normal[n], fields.parameters.frictions[index]) - v
        if change.norm_sqr() > 0:
            p = ti.cast(q[3] * change, ti.f64)
            force -= p
            torque -= r.cross(p)
            slope = coulomb_slope(v, surface, fields.mobile_nodes.normal[n], fields.parameters.frictions[index])
            K = ti.cast(q[3] * slope, ti.f64)
            zero = 0.0 * r[0]
            X = ti.Matrix([[zero, -r[2], r[1]], [r[2], zero, -r[0]], [-r[1], r[0], zero]])
            A += K
            B -= K @ X
            C += X @ K
            D -= X @ K @ X
    for i, j in ti.static(ti.ndrange(3, 3)):
        if ti.static(step.threads > 1):
            ti.atomic_add(fields.mobile_nodes.slope[i, j], A[i, j])
            ti.atomic_add(fields.mobile_nodes.slope[i, 3 + j], B[i, j])
            ti.atomic_add(fields.mobile_nodes.slope[3 + i, j], C[i, j])
            ti.atomic_add(fields.mobile_nodes.slope[3 + i, 3 + j], D[i, j])
        else:
            fields.mobile_nodes.slope[i, j], fields.mobile_nodes.slope[i, 3 + j] = A[i, j], B[i, j]
            fields.mobile_nodes.slope[3 + i, j], fields.mobile_nodes.slope[3 + i, 3 + j] = C[i, j], D[i, j]
    return sum_over_team(fields, step, force, torque)


@ti.func
def newton_step(fields: ti.template(), step: ti.template(), b: ti.template(), error):
    """Return the solution (6,) of (I + W slope) step = -error (6,)."""
    if step.thread == 0:
        eliminate(fields, step.mobile, b, error)
    wait(step)
    return ti.Vector([fields.mobile_nodes.system[i, 6] / fields.mobile_nodes.system[i, i] for i in ti.static(range(6))])


@ti.func
def eliminate(fields: ti.template(), mobile: ti.template(), b: ti.template(), error):
    """Bring the equations (I + W slope) step = -error (6,) to a diagonal, by Gaussian elimination with pivots."""
    size = ti.static(6 * len(fields.features.mobile))
    A = ti.static(fields.mobile_nodes.system)
    for i in range(6):
        for j in range(6):
            total = ti.cast(ti.select(i == j, 1.0, 0.0), ti.f64)
            for k in range(6):
                total += mobile[b, RESPONSE + i * size + 6 * b + k] * fields.mobile_nodes.slope[k, j]
            A[i, j] = total
    for i in ti.static(range(6)):
        A[i, 6] = -error[i]
    for i in range(6):
        best = i
        for k in range(i + 1, 6):
            if ti.abs(A[k, i]) > ti.abs(A[best, i]):
                best = k
        for j in range(7):
            A[i, j], A[best, j] = A[best, j], A[i, j]
        for k in range(6):
            if k != i:
                ratio = A[k, i] / A[i, i]
                for j in range(7):
                    A[k, j] = A[k, j] - ratio * A[i, j]


@ti.func
def scaled_norm(twist, radius):
    """Return the speed [m/s] of a twist at a radius [m]."""
    linear, angular = ti.Vector([twist[0], twist[1], twist[2]]), ti.Vector([twist[3], twist[4], twist[5]])
    return linear.norm() + radius * angular.norm()


@ti.func
def solve_contact(fields: ti.template(), step: ti.template(), corner):
    """Solve contact of the listed nodes with their colliders, one after the other; both sides get the impulse."""
    for b, index in ti.static(enumerate(fields.features.mobile)):
        if fields.mobile_nodes.count[b] > 0:
            if ti.static(fields.mobile_nodes.sorts):
                sort_by_part(fields.mobile_nodes.order, fields.mobile_nodes.part, fields.mobile_nodes.begins,
                             fields.mobile_nodes.first[b], fields.mobile_nodes.count[b])
            V = solve_twist(fields, step, b, index, corner)
            force, torque = apply_contact(fields, step, b, index, V, corner)
            if step.thread == 0:
                apply_impulse(fields, step.mobile, b, force, torque)
                moment = torque + read_vector(step.mobile, b, CENTRE).cross(force)
                for d in ti.static(range(3)):
                    add(step.out, fields.rows.first_collider + index, d, -force[d])
                    add(step.out, fields.rows.first_collider + index, 3 + d, -moment[d])
            wait(step)


@ti.func
def solve_twist(fields: ti.template(), step: ti.template(), b: ti.template(), index: ti.template(), corner):
    """Return the twist (6,) of a collider after contact, by Newton's method that halves steps which overshoot.
    Keeps the largest residual of the advance, relative to the change of the twist by contact, see SMALL_CHANGE."""
    start = ti.Vector([step.mobile[b, TWIST + i] for i in ti.static(range(6))])
    radius = ti.static(min(fields.colliders[index].sdf.radius, 1.0))
    V, best, move = start, start, start * 0.0
    least, scale = ti.cast(1e30, ti.f64), ti.cast(0.0, ti.f64)
    passes = 0
    while passes < MAX_PASSES:
        force, torque = reaction(fields, step, b, index, V, corner)
        change = change_of_twist(fields, step.mobile, b, force, torque)
        error = V - start - change
        size = scaled_norm(error, radius)
        passes += 1
        if size < least:
            least = size
            scale = scaled_norm(change, radius)
            best = V
            move = newton_step(fields, step, b, error)
        else:
            move = 0.5 * move
        V = best + move
        if least <= ti.static(fields.mobile_nodes.tolerance) * scaled_norm(change, radius):
            passes = MAX_PASSES
    if step.thread == 0:
        step.mobile[b, RESIDUAL] = ti.max(step.mobile[b, RESIDUAL], least / ti.max(scale, SMALL_CHANGE))
    return best


@ti.func
def apply_contact(fields: ti.template(), step: ti.template(), b: ti.template(), index: ti.template(), V, corner):
    """Apply contact with a collider of twist V to the listed nodes; return the impulse on it about its centre."""
    clear_sums(fields, step)
    linear, angular = ti.Vector([V[0], V[1], V[2]]), ti.Vector([V[3], V[4], V[5]])
    force, torque = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    for turn in range((fields.mobile_nodes.count[b] - step.thread + step.threads - 1) // step.threads):
        n = place_in_order(fields.mobile_nodes, fields.mobile_nodes.first[b] + step.threads * turn + step.thread)
        I = fields.mobile_nodes.node[n]
        q = fields.grid.nodes[I]
        r = lever_of(fields, step.mobile, b, I, corner)
        surface = surface_at(fields, linear, angular, r, n)
        v = ti.Vector([q[0], q[1], q[2]])
        new = coulomb(v, surface, fields.mobile_nodes.normal[n], fields.parameters.frictions[index])
        p = ti.cast(q[3] * (new - v), ti.f64)
        force -= p
        torque -= r.cross(p)
        fields.grid.nodes[I] = ti.Vector([new[0], new[1], new[2], q[3]])
    return sum_over_team(fields, step, force, torque)


@ti.func
def solve_mobile_contact(fields: ti.template(), step: ti.template(), first, last):
    """Phase: contact of the listed nodes with the mobile colliders, which then move to the end of the substep."""
    solve_contact(fields, step, fields.world_origin())
    if step.thread == 0:
        move_colliders(fields, step.mobile, step.motion, step.row, step.kick)


@ti.func
def reduce_by_compliance(fields: ti.template(), step: ti.template(), index: ti.template(), place, mass, dv):
    """Return the part of a particle's change of velocity that is left when its collider moves; move the collider.
    place: [m] (3,) in double precision. mass: [kg]. dv: [m/s] (3,) that a fixed collider would cause."""
    b = ti.static(fields.mobile_place[index])
    size = ti.cast(dv, ti.f64).norm(1e-30)
    compliance = contact_compliance(fields, step.mobile, b, place, ti.cast(dv, ti.f64) / size)
    reduced = dv * ti.cast(1.0 / (1.0 + ti.cast(mass, ti.f64) * compliance), fields.real)
    p = -ti.cast(mass * reduced, ti.f64)
    push_collider(fields, step, b, p, (place - read_vector(step.mobile, b, CENTRE)).cross(p))
    return reduced


@ti.func
def turn_by_shift(fields: ti.template(), step: ti.template(), index: ti.template(), mass, shift, v):
    """Credit a collider with the angular momentum that a particle of a mass [kg] with velocity v [m/s] (3,) gains by a
    shift [m] (3,) that is no motion, and take it from a mobile one."""
    moment = ti.cast(mass, ti.f64) * ti.cast(shift, ti.f64).cross(ti.cast(v, ti.f64))
    for d in ti.static(range(3)):
        add(step.out, fields.rows.first_collider + index, 3 + d, moment[d])
    if ti.static(fields.mobile_place[index] >= 0):
        push_collider(fields, step, ti.static(fields.mobile_place[index]), 0.0 * moment, -moment)


@ti.func
def push_collider(fields: ti.template(), step: ti.template(), b: ti.template(), force, torque):
    """Apply an impulse on a mobile collider about its centre after its substep; write what velocities follow."""
    apply_impulse(fields, step.mobile, b, force, torque)
    for a, row in ti.static(fields.features.mobile_rows):
        write_velocity(step.mobile, step.motion, step.row, a, row)
