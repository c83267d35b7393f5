"""Coulomb contact with a moving surface, and the pose and velocity of a collider in the motion table."""

from mpm.backend import once, ti
from mpm.geometry.rigid_motion import ANGULAR, AXES, LINEAR, ORIGIN


@ti.func
def coulomb(v, surface, normal, friction):
    """Return the velocity after contact with a moving surface: no approach, Coulomb friction up to sticking.
    v, surface: velocities [m/s] (3,). normal: unit vector (3,) out of the surface. Source: Stomakhin et al. 2013, ACM
    TOG 32(4):102, section 8."""
    relative = v - surface
    approach = relative.dot(normal)
    result = v
    if approach < 0:
        slide = relative - approach * normal
        speed = slide.norm(1e-12)
        result = surface + slide * ti.max(0.0, 1.0 + friction * approach / speed)
    return result


@ti.func
def coulomb_slope(v, surface, normal, friction):
    """Return the derivative (3, 3) of `coulomb` by the surface's velocity."""
    relative = v - surface
    approach = relative.dot(normal)
    identity = ti.Matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    result = 0.0 * identity
    if approach < 0:
        slide = relative - approach * normal
        speed = slide.norm(1e-12)
        held = -friction * approach / speed
        result = identity
        if held < 1:
            along = slide / speed
            across = identity - normal.outer_product(normal) - along.outer_product(along)
            result = (normal - friction * along).outer_product(normal) + held * across
    return result


@ti.func
def collider_origin(motion: ti.template(), k: ti.i32, s: ti.i32):
    """Return the origin [m] (3,) of the collider in row k of the motion table in substep s."""
    return ti.Vector([motion[k, s, ORIGIN + c] for c in ti.static(range(3))])


@ti.func
def collider_axes(motion: ti.template(), k: ti.i32, s: ti.i32):
    """Return the rotation matrix (3, 3) of the collider in row k in substep s."""
    m = [once(motion[k, s, AXES + c]) for c in range(9)]
    return ti.Matrix([[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]])


@ti.func
def surface_velocity(motion: ti.template(), k: ti.i32, s: ti.i32, r):
    """Return the velocity [m/s] (3,) of the collider in row k in substep s, at r [m] from its origin."""
    linear = ti.Vector([motion[k, s, LINEAR + c] for c in ti.static(range(3))])
    angular = ti.Vector([motion[k, s, ANGULAR + c] for c in ti.static(range(3))])
    return linear + angular.cross(r)
