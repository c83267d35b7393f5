"""Adjoints of Coulomb friction at a surface, and of what a moving surface is at a place, to the motion of the tool."""

from mpm.backend import ti
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
def surface_back(fields: ti.template(), index: ti.template(), motion: ti.template(), motion_bar: ti.template(),
                 s: ti.i32, R, r, y, n_t, surface_bar, normal_bar, phi_bar):
    """Add the adjoints of a surface's velocity, normal and distance at r from its origin to those of the tool's motion.
    Returns the adjoint of r."""
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
