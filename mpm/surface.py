"""A moving surface: where it is, how fast it moves, and how it stops what meets it."""

from mpm.backend import ti
from mpm.strain import keep


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
def tool_frame(motion: ti.template(), k: ti.i32, s: ti.i32):
    """Origin, rotation matrix, linear and angular velocity of moving collider k in substep s."""
    m = [keep(motion[k, s, c]) for c in range(18)]
    return (ti.Vector([m[0], m[1], m[2]]),
            ti.Matrix([[m[3], m[4], m[5]], [m[6], m[7], m[8]], [m[9], m[10], m[11]]]),
            ti.Vector([m[12], m[13], m[14]]), ti.Vector([m[15], m[16], m[17]]))
