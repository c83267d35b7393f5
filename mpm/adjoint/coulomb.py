"""Adjoints of Coulomb friction at a surface, and of what a moving surface is at a place, to the motion of the tool."""

from mpm.backend import ti
from mpm.boundaries.coulomb import collider_axes, collider_origin, surface_velocity
from mpm.geometry.rigid_motion import ANGULAR, AXES, LINEAR, ORIGIN


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
def velocity_back(step: ti.template(), s: ti.i32, r, bar):
    """Add the adjoint of a surface's velocity at r from its origin to those of the tool's motion; return that of r."""
    r_bar = bar.cross(ti.Vector([step.motion[0, s, ANGULAR + c] for c in ti.static(range(3))]))
    turn_bar = r.cross(bar)
    for c in ti.static(range(3)):
        add(step.motion_bar, s, ORIGIN + c, -r_bar[c])
        add(step.motion_bar, s, LINEAR + c, bar[c])
        add(step.motion_bar, s, ANGULAR + c, turn_bar[c])
    return r_bar


@ti.func
def distance_back(fields: ti.template(), index: ti.template(), step: ti.template(), s: ti.i32, R, r, n_t, normal_bar,
                  phi_bar):
    """Add the adjoints of a surface's normal and distance at r from its origin to those of the tool's pose.
    n_t: the normal in the tool's frame. Returns the adjoint of r."""
    y_bar = fields.colliders[index].sdf.at_back(R.transpose() @ r, R.transpose() @ normal_bar, phi_bar, fields.real)
    r_bar, R_bar = R @ y_bar, normal_bar.outer_product(n_t) + r.outer_product(y_bar)
    for c in ti.static(range(3)):
        add(step.motion_bar, s, ORIGIN + c, -r_bar[c])
        for k in ti.static(range(3)):
            add(step.motion_bar, s, AXES + 3 * c + k, R_bar[c, k])
    return r_bar


@ti.func
def face_back(a: ti.template(), step: ti.template(), row: ti.template(), index: ti.template(), place, normal,
              surface_bar, normal_bar, ahead):
    """Add the adjoints of a face's velocity in a substep, and of the normal that the stride began with.
    place: [m] (3,) of the node. normal: on the side where the collider's distance is positive. ahead: time [s] by which
    the collider was moved on for it."""
    velocity_back(step, step.row, place - collider_origin(step.motion, row, step.row), surface_bar)
    R, r = collider_axes(step.motion, row, step.begin), place - collider_origin(step.motion, row, step.begin)
    moved_bar = distance_back(a.fields, index, step, step.begin, R,
                              r - ahead * surface_velocity(step.motion, row, step.begin, r), R.transpose() @ normal,
                              normal_bar, 0.0 * ahead)
    velocity_back(step, step.begin, r, -ahead * moved_bar)


@ti.func
def add(table: ti.template(), s: ti.i32, place: ti.template(), value):
    """Add to an entry of a double-precision table."""
    table[s, place] = table[s, place] + ti.cast(value, ti.f64)
