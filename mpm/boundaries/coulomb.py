"""A moving surface: where it is, how fast it moves, and how it stops what meets it."""

from mpm.backend import ti
from mpm.materials.hencky_strain import keep


@ti.func
def coulomb(v, surface, normal, friction):
    """Velocity after contact with a surface that moves with `surface`: no approach, friction up to sticking.

    Stomakhin et al. 2013, ACM TOG 32(4):102, section 8.
    """
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
    """Derivative (3, 3) of `coulomb` by the surface's velocity."""
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
def tool_origin(motion: ti.template(), k: ti.i32, s: ti.i32):
    """Origin of moving collider k in substep s."""
    return ti.Vector([motion[k, s, c] for c in ti.static(range(3))])


@ti.func
def tool_axes(motion: ti.template(), k: ti.i32, s: ti.i32):
    """Rotation matrix of moving collider k in substep s."""
    m = [keep(motion[k, s, 3 + c]) for c in range(9)]
    return ti.Matrix([[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]])


@ti.func
def surface_velocity(motion: ti.template(), k: ti.i32, s: ti.i32, r):
    """Velocity of moving collider k in substep s at r from its origin."""
    linear = ti.Vector([motion[k, s, 12 + c] for c in ti.static(range(3))])
    angular = ti.Vector([motion[k, s, 15 + c] for c in ti.static(range(3))])
    return linear + angular.cross(r)
