"""Motion of mobile colliders within a launch: the table of their twists, poses and mobilities."""

from mpm.backend import is_vulkan, ti
from mpm.geometry import rigid_motion

CENTRE, AXES, LEVER, TWIST, RATE, IMPULSE, RESIDUAL, RESPONSE = 0, 3, 12, 15, 21, 27, 33, 34
"""Columns of the table of mobile colliders: centre; frame's axes; origin of the frame from the centre, in the frame;
twist about the centre; its free rate of change; impulse received in this advance, about the centre as it moves; largest
relative residual of its contact solves; then the changes of the twist by impulses on every mobile collider."""


@ti.func
def read_vector(mobile: ti.template(), b: ti.template(), column: ti.template()):
    """Return three numbers of the table of mobile colliders."""
    return ti.Vector([mobile[b, column + d] for d in ti.static(range(3))])


@ti.func
def read_matrix(mobile: ti.template(), b: ti.template()):
    """Return the rotation matrix of a mobile collider's frame."""
    m = ti.static(AXES)
    return ti.Matrix([[mobile[b, m + 3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))])


@ti.func
def write_motion(fields: ti.template(), mobile: ti.template(), motion: ti.template(), s: ti.i32):
    """Write pose and velocity of the mobile colliders to the motion table, which contact reads."""
    for b, row in ti.static(fields.features.mobile_rows):
        R = read_matrix(mobile, b)
        origin = read_vector(mobile, b, CENTRE) + R @ read_vector(mobile, b, LEVER)
        for d in ti.static(range(3)):
            motion[row, s, ti.static(rigid_motion.ORIGIN) + d] = origin[d]
            for c in ti.static(range(3)):
                motion[row, s, ti.static(rigid_motion.AXES) + 3 * d + c] = R[d, c]
        write_velocity(mobile, motion, s, b, row)


@ti.func
def write_velocity(mobile: ti.template(), motion: ti.template(), s: ti.i32, b: ti.template(), row: ti.template()):
    """Write a mobile collider's velocity at the origin of its frame to the motion table."""
    angular = read_vector(mobile, b, TWIST + 3)
    linear = read_vector(mobile, b, TWIST) + angular.cross(read_matrix(mobile, b) @ read_vector(mobile, b, LEVER))
    for d in ti.static(range(3)):
        motion[row, s, ti.static(rigid_motion.LINEAR) + d] = linear[d]
        motion[row, s, ti.static(rigid_motion.ANGULAR) + d] = angular[d]


@ti.func
def start_mobile_colliders(fields: ti.template(), step: ti.template(), first, last):
    """Phase: advance the twists by what acts on the colliders besides particles; empty the lists of nodes."""
    mobile, motion = ti.static(step.mobile, step.motion)
    for b in ti.static(range(len(fields.features.mobile))):
        fields.mobile_nodes.count[b] = 0
        for i in ti.static(range(6)):
            mobile[b, TWIST + i] = mobile[b, TWIST + i] + step.kick * mobile[b, RATE + i]
    write_motion(fields, mobile, motion, step.row)


@ti.func
def sine(angle):
    """Return the sine of a small angle: Taichi's code for Vulkan has none in double precision."""
    square = angle * angle
    result = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))))
    if ti.static(not is_vulkan()):
        result = ti.sin(angle)
    return result


@ti.func
def move_colliders(fields: ti.template(), mobile: ti.template(), motion: ti.template(), s: ti.i32, dt):
    """Move the mobile colliders along their twists to the end of the substep."""
    for b in ti.static(range(len(fields.features.mobile))):
        R = read_matrix(mobile, b)
        turn = dt * read_vector(mobile, b, TWIST + 3)
        angle = ti.max(turn.norm(), 1e-9)
        K = ti.Matrix([[0.0 * angle, -turn[2], turn[1]], [turn[2], 0.0 * angle, -turn[0]],
                       [-turn[1], turn[0], 0.0 * angle]])
        half = sine(0.5 * angle) / angle
        R += (sine(angle) / angle * K + 2.0 * half * half * K @ K) @ R
        for i in ti.static(range(3)):
            mobile[b, CENTRE + i] = mobile[b, CENTRE + i] + dt * mobile[b, TWIST + i]
            for j in ti.static(range(3)):
                mobile[b, AXES + 3 * i + j] = R[i, j]
    write_motion(fields, mobile, motion, s)


@ti.func
def apply_impulse(fields: ti.template(), mobile: ti.template(), b: ti.template(), force, torque):
    """Change the twists of all mobile colliders by an impulse on one of them, about its centre."""
    size = ti.static(6 * len(fields.features.mobile))
    P = [force[0], force[1], force[2], torque[0], torque[1], torque[2]]
    for i in ti.static(range(6)):
        mobile[b, IMPULSE + i] = mobile[b, IMPULSE + i] + P[i]
    for a in ti.static(range(len(fields.features.mobile))):
        for i in ti.static(range(6)):
            change = ti.cast(0.0, ti.f64)
            for j in ti.static(range(6)):
                change += mobile[a, RESPONSE + i * size + 6 * b + j] * P[j]
            mobile[a, TWIST + i] = mobile[a, TWIST + i] + change


@ti.func
def change_of_twist(fields: ti.template(), mobile: ti.template(), b: ti.template(), force, torque):
    """Return the change of a collider's own twist (6,) by an impulse on it."""
    size = ti.static(6 * len(fields.features.mobile))
    P = [force[0], force[1], force[2], torque[0], torque[1], torque[2]]
    result = ti.Vector.zero(ti.f64, 6)
    for i in ti.static(range(6)):
        for j in ti.static(range(6)):
            result[i] += mobile[b, RESPONSE + i * size + 6 * b + j] * P[j]
    return result
