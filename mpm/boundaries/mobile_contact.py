"""Colliders that contact moves: their twist and the velocities of the nodes they touch are solved for together.

In every substep the nodes inside a mobile collider are listed instead of being stopped one by one. With p(V) the
impulses that Coulomb contact with a collider of twist V gives the nodes, and W its mobility, V = V* - W sum G^T p(V) is
solved by Newton's method in six unknowns, whatever the number of nodes: no mass ratio is too large for it. The same
impulses then act on both, so that what the grains gain the collider loses, to rounding. (The reduction of a body's
contacts to six unknowns follows Batty et al. 2007, ACM TOG 26(3):100, and Daviet and Bertails-Descoubes 2016, ACM TOG
35(4):102.)
"""

import numpy as np

from mpm.backend import real_type, ti
from mpm.boundaries.coulomb import coulomb, coulomb_slope
from mpm.scene.grid import in_first_layer
from mpm.state.ledger import position

CENTRE, AXES, LEVER, TWIST, RATE, IMPULSE, RESPONSE = 0, 3, 12, 15, 21, 27, 33
"""Columns of the table of mobile colliders: centre; frame's axes; origin of the frame from the centre, in the frame;
twist about the centre; its free rate of change; impulse received in this advance, about the centre as it moves; then
the twist's answers to impulses on every mobile collider."""
MAX_PASSES = 12
"""Sweeps over the listed nodes in one solve; two or three are the rule."""
TOLERANCE = {"f32": 1e-5, "f64": 1e-11}
"""Error at which the solve ends, relative to the change of twist by contact."""


class MobileFields:
    """The nodes that each mobile collider touches in this substep, and room for six equations."""

    def __init__(self, capacities: list[int], precision: str) -> None:
        real = real_type(precision)
        self.tolerance = TOLERANCE[precision]
        ends = np.cumsum(capacities)
        self.first = [int(end - n) for end, n in zip(ends, capacities)]
        """First place of each collider in the lists."""
        self.count = ti.field(ti.i32, len(capacities))
        """Nodes on each collider's list."""
        self.node = ti.Vector.field(3, ti.i32, int(ends[-1]))
        self.normal = ti.Vector.field(3, real, int(ends[-1]))
        """Out of the collider, in world axes."""
        self.slope = ti.field(ti.f64, (6, 6))
        """Derivative of the impulse on the nodes by the collider's twist."""
        self.system = ti.field(ti.f64, (6, 7))
        """Newton's equations, the right-hand side in the last column."""


@ti.func
def vector(mobile: ti.template(), b: ti.template(), column: ti.template()):
    """Three numbers of the table."""
    return ti.Vector([mobile[b, column + d] for d in ti.static(range(3))])


@ti.func
def matrix(mobile: ti.template(), b: ti.template()):
    """Axes of a collider's frame."""
    m = ti.static(AXES)
    return ti.Matrix([[mobile[b, m + 3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))])


@ti.func
def to_table(scene: ti.template(), mobile: ti.template(), motion: ti.template(), s: ti.i32):
    """Write where the mobile colliders are and how they move to the motion table, which contact reads."""
    for b, row in ti.static(scene.features.mobile_rows):
        R = matrix(mobile, b)
        origin = vector(mobile, b, CENTRE) + R @ vector(mobile, b, LEVER)
        for d in ti.static(range(3)):
            motion[row, s, d] = origin[d]
            for c in ti.static(range(3)):
                motion[row, s, 3 + 3 * d + c] = R[d, c]
        velocity_to_table(mobile, motion, s, b, row)


@ti.func
def velocity_to_table(mobile: ti.template(), motion: ti.template(), s: ti.i32, b: ti.template(), row: ti.template()):
    """Write a mobile collider's velocity, at the origin of its frame."""
    angular = vector(mobile, b, TWIST + 3)
    linear = vector(mobile, b, TWIST) + angular.cross(matrix(mobile, b) @ vector(mobile, b, LEVER))
    for d in ti.static(range(3)):
        motion[row, s, 12 + d] = linear[d]
        motion[row, s, 15 + d] = angular[d]


@ti.func
def begin_mobiles(scene: ti.template(), mobile: ti.template(), motion: ti.template(), s: ti.i32, dt):
    """Twists after what acts on the colliders besides grains; empties the lists."""
    for b in ti.static(range(len(scene.features.mobile))):
        scene.mobiles.count[b] = 0
        for i in ti.static(range(6)):
            mobile[b, TWIST + i] = mobile[b, TWIST + i] + dt * mobile[b, RATE + i]
    to_table(scene, mobile, motion, s)


@ti.func
def move_mobiles(scene: ti.template(), mobile: ti.template(), motion: ti.template(), s: ti.i32, dt):
    """Carry the colliders along their twists to the end of the substep."""
    for b in ti.static(range(len(scene.features.mobile))):
        R = matrix(mobile, b)
        turn = dt * vector(mobile, b, TWIST + 3)
        angle = ti.max(turn.norm(), 1e-9)
        K = ti.Matrix([[0.0 * angle, -turn[2], turn[1]], [turn[2], 0.0 * angle, -turn[0]],
                       [-turn[1], turn[0], 0.0 * angle]])
        half = ti.sin(0.5 * angle) / angle
        R += (ti.sin(angle) / angle * K + 2.0 * half * half * K @ K) @ R
        for i in ti.static(range(3)):
            mobile[b, CENTRE + i] = mobile[b, CENTRE + i] + dt * mobile[b, TWIST + i]
            for j in ti.static(range(3)):
                mobile[b, AXES + 3 * i + j] = R[i, j]
    to_table(scene, mobile, motion, s)


@ti.func
def list_node(mobiles: ti.template(), b: ti.template(), I, normal):
    """Put a node on a collider's list."""
    place = mobiles.first[b] + mobiles.count[b]
    mobiles.count[b] = mobiles.count[b] + 1
    mobiles.node[place] = I
    mobiles.normal[place] = normal


@ti.func
def push(scene: ti.template(), mobile: ti.template(), b: ti.template(), force, torque):
    """Change the twists of all mobile colliders by an impulse on one of them, about its centre."""
    size = ti.static(6 * len(scene.features.mobile))
    P = [force[0], force[1], force[2], torque[0], torque[1], torque[2]]
    for i in ti.static(range(6)):
        mobile[b, IMPULSE + i] = mobile[b, IMPULSE + i] + P[i]
    for a in ti.static(range(len(scene.features.mobile))):
        for i in ti.static(range(6)):
            change = ti.cast(0.0, ti.f64)
            for j in ti.static(range(6)):
                change += mobile[a, RESPONSE + i * size + 6 * b + j] * P[j]
            mobile[a, TWIST + i] = mobile[a, TWIST + i] + change


@ti.func
def yielding(scene: ti.template(), mobile: ti.template(), b: ti.template(), place, direction):
    """Velocity [m/s per N s] with which a collider's surface at a place gives way to an impulse along a direction."""
    size = ti.static(6 * len(scene.features.mobile))
    n = ti.cast(direction, ti.f64)
    arm = (place - vector(mobile, b, CENTRE)).cross(n)
    P = [n[0], n[1], n[2], arm[0], arm[1], arm[2]]
    total = ti.cast(0.0, ti.f64)
    for i in ti.static(range(6)):
        for j in ti.static(range(6)):
            total += P[i] * mobile[b, RESPONSE + i * size + 6 * b + j] * P[j]
    return total


@ti.func
def lever_of(scene: ti.template(), mobile: ti.template(), b: ti.template(), I, corner):
    """From the collider's centre to a node of either layer."""
    return position(in_first_layer(scene.grid, I), corner, scene.cell) - vector(mobile, b, CENTRE)


@ti.func
def reaction(scene: ti.template(), mobile: ti.template(), b: ti.template(), index: ti.template(), V, corner):
    """Impulse that the listed nodes would give a collider of twist V; stores its derivative, negative, in `slope`."""
    force, torque = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    A, B = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    C, D = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    linear, angular = ti.Vector([V[0], V[1], V[2]]), ti.Vector([V[3], V[4], V[5]])
    for n in range(scene.mobiles.first[b], scene.mobiles.first[b] + scene.mobiles.count[b]):
        I = scene.mobiles.node[n]
        q = scene.grid.nodes[I]
        r = lever_of(scene, mobile, b, I, corner)
        surface = ti.cast(linear + angular.cross(r), scene.grid.nodes.dtype)
        v = ti.Vector([q[0], q[1], q[2]])
        change = coulomb(v, surface, scene.mobiles.normal[n], scene.numbers.frictions[index]) - v
        if change.norm_sqr() > 0:
            p = ti.cast(q[3] * change, ti.f64)
            force -= p
            torque -= r.cross(p)
            slope = coulomb_slope(v, surface, scene.mobiles.normal[n], scene.numbers.frictions[index])
            K = ti.cast(q[3] * slope, ti.f64)
            zero = 0.0 * r[0]
            X = ti.Matrix([[zero, -r[2], r[1]], [r[2], zero, -r[0]], [-r[1], r[0], zero]])
            A += K
            B -= K @ X
            C += X @ K
            D -= X @ K @ X
    for i, j in ti.static(ti.ndrange(3, 3)):
        scene.mobiles.slope[i, j], scene.mobiles.slope[i, 3 + j] = A[i, j], B[i, j]
        scene.mobiles.slope[3 + i, j], scene.mobiles.slope[3 + i, 3 + j] = C[i, j], D[i, j]
    return force, torque


@ti.func
def response(scene: ti.template(), mobile: ti.template(), b: ti.template(), force, torque):
    """Change of a collider's own twist (6,) by an impulse on it."""
    size = ti.static(6 * len(scene.features.mobile))
    P = [force[0], force[1], force[2], torque[0], torque[1], torque[2]]
    result = ti.Vector.zero(ti.f64, 6)
    for i in ti.static(range(6)):
        for j in ti.static(range(6)):
            result[i] += mobile[b, RESPONSE + i * size + 6 * b + j] * P[j]
    return result


@ti.func
def newton_step(scene: ti.template(), mobile: ti.template(), b: ti.template(), error):
    """Solution (6,) of (I + W slope) step = -error, by elimination with pivots."""
    size = ti.static(6 * len(scene.features.mobile))
    A = ti.static(scene.mobiles.system)
    for i in range(6):
        for j in range(6):
            total = ti.cast(ti.select(i == j, 1.0, 0.0), ti.f64)
            for k in range(6):
                total += mobile[b, RESPONSE + i * size + 6 * b + k] * scene.mobiles.slope[k, j]
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
    """Speed [m/s] that a twist means at a radius."""
    linear, angular = ti.Vector([twist[0], twist[1], twist[2]]), ti.Vector([twist[3], twist[4], twist[5]])
    return linear.norm() + radius * angular.norm()


@ti.func
def meet(scene: ti.template(), mobile: ti.template(), corner, out: ti.template()):
    """Contact of the listed nodes with their colliders, one collider after the other; both sides get the impulse."""
    for b, index in ti.static(enumerate(scene.features.mobile)):
        if scene.mobiles.count[b] > 0:
            V = solved_twist(scene, mobile, b, index, corner)
            force, torque = give(scene, mobile, b, index, V, corner)
            push(scene, mobile, b, force, torque)
            moment = torque + vector(mobile, b, CENTRE).cross(force)
            for d in ti.static(range(3)):
                out[scene.first_collider_row + index, d] = out[scene.first_collider_row + index, d] - force[d]
                out[scene.first_collider_row + index, 3 + d] = \
                    out[scene.first_collider_row + index, 3 + d] - moment[d]


@ti.func
def solved_twist(scene: ti.template(), mobile: ti.template(), b: ti.template(), index: ti.template(), corner):
    """Twist (6,) that a collider has after contact, by Newton's method with halved steps where it overshoots."""
    start = ti.Vector([mobile[b, TWIST + i] for i in ti.static(range(6))])
    radius = ti.static(min(scene.colliders[index].sdf.radius, 1.0))
    V, best, step = start, start, start * 0.0
    least = ti.cast(1e30, ti.f64)
    passes = 0
    while passes < MAX_PASSES:
        force, torque = reaction(scene, mobile, b, index, V, corner)
        answer = response(scene, mobile, b, force, torque)
        error = V - start - answer
        size = scaled_norm(error, radius)
        passes += 1
        if size < least:
            least = size
            best = V
            step = newton_step(scene, mobile, b, error)
        else:
            step = 0.5 * step
        V = best + step
        if least <= ti.static(scene.mobiles.tolerance) * scaled_norm(answer, radius):
            passes = MAX_PASSES
    return best


@ti.func
def give(scene: ti.template(), mobile: ti.template(), b: ti.template(), index: ti.template(), V, corner):
    """Stop the listed nodes at a collider of twist V; the impulse on the collider about its centre."""
    linear, angular = ti.Vector([V[0], V[1], V[2]]), ti.Vector([V[3], V[4], V[5]])
    force, torque = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    for n in range(scene.mobiles.first[b], scene.mobiles.first[b] + scene.mobiles.count[b]):
        I = scene.mobiles.node[n]
        q = scene.grid.nodes[I]
        r = lever_of(scene, mobile, b, I, corner)
        surface = ti.cast(linear + angular.cross(r), scene.grid.nodes.dtype)
        v = ti.Vector([q[0], q[1], q[2]])
        new = coulomb(v, surface, scene.mobiles.normal[n], scene.numbers.frictions[index])
        p = ti.cast(q[3] * (new - v), ti.f64)
        force -= p
        torque -= r.cross(p)
        scene.grid.nodes[I] = ti.Vector([new[0], new[1], new[2], q[3]])
    return force, torque

@ti.func
def shared(scene: ti.template(), mobile: ti.template(), motion: ti.template(), s: ti.i32, index: ti.template(),
           place, mass, dv):
    """What is left of a grain's change of velocity when the mobile collider gives way; moves the collider."""
    b = ti.static(scene.mobile_place[index])
    size = ti.cast(dv, ti.f64).norm(1e-30)
    way = yielding(scene, mobile, b, place, ti.cast(dv, ti.f64) / size)
    left = dv * ti.cast(1.0 / (1.0 + ti.cast(mass, ti.f64) * way), scene.grid.nodes.dtype)
    p = -ti.cast(mass * left, ti.f64)
    push(scene, mobile, b, p, (place - vector(mobile, b, CENTRE)).cross(p))
    for a, row in ti.static(scene.features.mobile_rows):
        velocity_to_table(mobile, motion, s, a, row)
    return left
