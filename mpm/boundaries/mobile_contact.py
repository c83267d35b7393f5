"""Colliders that contact moves: their twist and the velocities of the nodes they touch are solved for together.

In every substep the nodes inside a mobile collider are listed instead of being stopped one by one. With p(V) the
impulses that Coulomb contact with a collider of twist V gives the nodes, and W its mobility, V = V* - W sum G^T p(V) is
solved by Newton's method in six unknowns, whatever the number of nodes: no mass ratio is too large for it. The same
impulses then act on both, so that what the grains gain the collider loses, to rounding. (The reduction of a body's
contacts to six unknowns follows Batty et al. 2007, ACM TOG 26(3):100, and Daviet and Bertails-Descoubes 2016, ACM TOG
35(4):102.)
"""

from mpm.backend import ti
from mpm.boundaries.coulomb import coulomb, coulomb_slope
from mpm.boundaries.mobile_motion import (
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
from mpm.state.ledger import position
from mpm.state.nodes import in_first_layer

MAX_PASSES = 100
"""Sweeps over the listed nodes in one solve. Two or three are the rule; a body a hundred times lighter than the grains
that it lands on can take more than 80, most of them to shorten steps."""
SMALL_CHANGE = 1e-3
"""Change of a twist [m/s] by contact below which the residual is taken relative to this, as it does not matter then."""


@ti.func
def list_node(lists: ti.template(), b: ti.template(), I, normal):
    """Put a node on a collider's list."""
    place = lists.first[b] + lists.count[b]
    lists.count[b] = lists.count[b] + 1
    lists.node[place] = I
    lists.normal[place] = normal


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
def reaction(fields: ti.template(), mobile: ti.template(), b: ti.template(), index: ti.template(), V, corner):
    """Return the impulse of the listed nodes on a collider of twist V; store its negative derivative in `slope`."""
    force, torque = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    A, B = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    C, D = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    linear, angular = ti.Vector([V[0], V[1], V[2]]), ti.Vector([V[3], V[4], V[5]])
    for n in range(fields.mobile_nodes.first[b], fields.mobile_nodes.first[b] + fields.mobile_nodes.count[b]):
        I = fields.mobile_nodes.node[n]
        q = fields.grid.nodes[I]
        r = lever_of(fields, mobile, b, I, corner)
        surface = ti.cast(linear + angular.cross(r), fields.real)
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
        fields.mobile_nodes.slope[i, j], fields.mobile_nodes.slope[i, 3 + j] = A[i, j], B[i, j]
        fields.mobile_nodes.slope[3 + i, j], fields.mobile_nodes.slope[3 + i, 3 + j] = C[i, j], D[i, j]
    return force, torque


@ti.func
def newton_step(fields: ti.template(), mobile: ti.template(), b: ti.template(), error):
    """Solve (I + W slope) step = -error (6,) by Gaussian elimination with pivots."""
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
    return ti.Vector([A[i, 6] / A[i, i] for i in ti.static(range(6))])


@ti.func
def scaled_norm(twist, radius):
    """Return the speed [m/s] of a twist at a radius [m]."""
    linear, angular = ti.Vector([twist[0], twist[1], twist[2]]), ti.Vector([twist[3], twist[4], twist[5]])
    return linear.norm() + radius * angular.norm()


@ti.func
def solve_contact(fields: ti.template(), mobile: ti.template(), corner, out: ti.template()):
    """Solve contact of the listed nodes with their colliders, one after the other; both sides get the impulse."""
    for b, index in ti.static(enumerate(fields.features.mobile)):
        if fields.mobile_nodes.count[b] > 0:
            V = solve_twist(fields, mobile, b, index, corner)
            force, torque = apply_contact(fields, mobile, b, index, V, corner)
            apply_impulse(fields, mobile, b, force, torque)
            moment = torque + read_vector(mobile, b, CENTRE).cross(force)
            for d in ti.static(range(3)):
                out[fields.rows.first_collider + index, d] = out[fields.rows.first_collider + index, d] - force[d]
                out[fields.rows.first_collider + index, 3 + d] = \
                    out[fields.rows.first_collider + index, 3 + d] - moment[d]


@ti.func
def solve_twist(fields: ti.template(), mobile: ti.template(), b: ti.template(), index: ti.template(), corner):
    """Return the twist (6,) of a collider after contact, by Newton's method that halves steps which overshoot.

    Keeps the largest residual of the advance, relative to the change of the twist by contact, see SMALL_CHANGE.
    """
    start = ti.Vector([mobile[b, TWIST + i] for i in ti.static(range(6))])
    radius = ti.static(min(fields.colliders[index].sdf.radius, 1.0))
    V, best, step = start, start, start * 0.0
    least, scale = ti.cast(1e30, ti.f64), ti.cast(0.0, ti.f64)
    passes = 0
    while passes < MAX_PASSES:
        force, torque = reaction(fields, mobile, b, index, V, corner)
        change = change_of_twist(fields, mobile, b, force, torque)
        error = V - start - change
        size = scaled_norm(error, radius)
        passes += 1
        if size < least:
            least = size
            scale = scaled_norm(change, radius)
            best = V
            step = newton_step(fields, mobile, b, error)
        else:
            step = 0.5 * step
        V = best + step
        if least <= ti.static(fields.mobile_nodes.tolerance) * scaled_norm(change, radius):
            passes = MAX_PASSES
    mobile[b, RESIDUAL] = ti.max(mobile[b, RESIDUAL], least / ti.max(scale, SMALL_CHANGE))
    return best


@ti.func
def apply_contact(fields: ti.template(), mobile: ti.template(), b: ti.template(), index: ti.template(), V, corner):
    """Apply contact with a collider of twist V to the listed nodes; return the impulse on it about its centre."""
    linear, angular = ti.Vector([V[0], V[1], V[2]]), ti.Vector([V[3], V[4], V[5]])
    force, torque = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    for n in range(fields.mobile_nodes.first[b], fields.mobile_nodes.first[b] + fields.mobile_nodes.count[b]):
        I = fields.mobile_nodes.node[n]
        q = fields.grid.nodes[I]
        r = lever_of(fields, mobile, b, I, corner)
        surface = ti.cast(linear + angular.cross(r), fields.real)
        v = ti.Vector([q[0], q[1], q[2]])
        new = coulomb(v, surface, fields.mobile_nodes.normal[n], fields.parameters.frictions[index])
        p = ti.cast(q[3] * (new - v), ti.f64)
        force -= p
        torque -= r.cross(p)
        fields.grid.nodes[I] = ti.Vector([new[0], new[1], new[2], q[3]])
    return force, torque


@ti.func
def solve_mobile_contact(fields: ti.template(), step: ti.template(), first, last):
    """Phase: contact of the listed nodes with the mobile colliders, which then move to the end of the substep."""
    solve_contact(fields, step.mobile, fields.world_origin(), step.out)
    move_colliders(fields, step.mobile, step.motion, step.row, step.dt)


@ti.func
def reduce_by_compliance(fields: ti.template(), step: ti.template(), index: ti.template(), place, mass, dv):
    """Return the part of a particle's change of velocity that is left when its collider moves; move the collider.

    place: [m] (3,) in double precision. mass: [kg]. dv: [m/s] (3,) that a fixed collider would cause.
    """
    b = ti.static(fields.mobile_place[index])
    size = ti.cast(dv, ti.f64).norm(1e-30)
    compliance = contact_compliance(fields, step.mobile, b, place, ti.cast(dv, ti.f64) / size)
    reduced = dv * ti.cast(1.0 / (1.0 + ti.cast(mass, ti.f64) * compliance), fields.real)
    p = -ti.cast(mass * reduced, ti.f64)
    apply_impulse(fields, step.mobile, b, p, (place - read_vector(step.mobile, b, CENTRE)).cross(p))
    for a, row in ti.static(fields.features.mobile_rows):
        write_velocity(step.mobile, step.motion, step.row, a, row)
    return reduced
