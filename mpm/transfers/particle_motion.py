"""Motion of particles: how long they drift before and after a stride, and where walls hold them."""

from mpm.backend import ti


@ti.func
def drift_before(dt, span: ti.i32):
    """Return the time [s] that particles drift before a stride of `span` substeps: 0 before a single substep."""
    return 0.5 * dt * (span - 1)


@ti.func
def drift_after(dt, span: ti.i32):
    """Return the time [s] that particles drift after a stride of `span` substeps; 0 for span 0, within one."""
    return 0.5 * dt * (span + (span > 0))


@ti.func
def keep_inside(fields: ti.template(), x, axis: ti.template()):
    """Return a coordinate [m], or a pack of them, after a move: wrapped on a periodic axis, held by walls on others."""
    low = fields.corner
    high = fields.corner + fields.span[axis]
    result = x
    if ti.static(fields.features.periodic[axis]):
        result = ti.select(x < low, x + fields.span[axis], ti.select(x >= high, x - fields.span[axis], x))
    else:  # holds a particle that an inaccurate step would carry through a wall
        result = ti.max(ti.min(x, high), low)
    return result
