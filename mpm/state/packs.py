"""Packs of particles: the lanes of a pack, the loops of kernels over packs, and copies of pack fields.
Kernels run over the places 0 .. `count_packs` - 1; `pack_at` says which pack stands at a place. Both leave out packs
that need no update."""

import numpy as np

from mpm.backend import is_shared, later, ti
from mpm.backend.launching import Launcher
from mpm.errors import InvalidValue

LANES = 4
"""Particles in a pack. Four fills the registers of common processors; eight spills them."""


@ti.func
def lane_mask(lane, real: ti.template()):
    """Return 1 in one lane of a pack and 0 in the others: reads by a product what a run-time index would spill."""
    return ti.Vector([ti.cast(lane == l, real) for l in range(LANES)])


@ti.func
def write_lane(field: ti.template(), q, mask, value):
    """Store a value in the lane of pack q that a mask selects."""
    field[q] = field[q] * (1.0 - mask) + value * mask


@ti.func
def read_lane(field: ti.template(), slot):
    """Return the value of a pack field in a slot (pack, lane)."""
    value = field[slot[0]][0]
    for l in ti.static(range(1, LANES)):
        if slot[1] == l:
            value = field[slot[0]][l]
    return value


@ti.func
def is_near(fields: ti.template(), x: ti.template(), q, place, radius: ti.template()):
    """Return whether a particle of pack q, of coordinates x, lies within a radius [m] of a place [m] in the world."""
    d2 = (x[0][q] + fields.origin[0] - place[0]) ** 2 + (x[1][q] + fields.origin[1] - place[1]) ** 2 \
        + (x[2][q] + fields.origin[2] - place[2]) ** 2
    return d2.min() < ti.static(radius**2)


@ti.func
def count_packs(fields: ti.template()):
    """Return the number of packs that phases run over."""
    count = 0
    if ti.static(fields.features.sleep):  # noqa: SIM108  (decided when compiling)
        count = fields.sleepers.count[None]
    else:
        count = fields.particles.pack_count[None]
    return count


@ti.func
def packs_of_body(fields: ti.template(), body, first, last):
    """Return first and last + 1 of the places of a body's packs that lie within first .. last - 1."""
    begin, end = first, last
    if ti.static(fields.features.sleep):
        ends = fields.sleepers.ranges[body]
        begin, end = ti.max(first, ends[0]), ti.min(last, ends[1])
    else:
        ends = fields.particles.range_table[body]
        begin, end = ti.max(first, ends[0]), ti.min(last, ends[1])
    return begin, end


@ti.func
def pack_at(fields: ti.template(), place):
    """Return the pack at a place."""
    q = place
    if ti.static(fields.features.sleep):
        q = fields.sleepers.awake[place]
    return q


@ti.func
def active_lanes(fields: ti.template(), q):
    """Return the lanes of pack q that are updated, a bit each."""
    bits = 2**LANES - 1
    if ti.static(fields.features.sleep):
        bits -= fields.sleepers.lanes_asleep[q]
    return bits


@ti.func
def is_active(fields: ti.template(), q, l):
    """Return 1 where lane l of pack q is updated, else 0."""
    return (active_lanes(fields, q) >> l) & 1


@ti.func
def lowest_bit(bits):
    """Return the number of the lowest bit that is set among those of a pack's lanes."""
    lane = 0
    for l in ti.static(range(LANES - 1, 0, -1)):
        if bits & (1 << l):
            lane = l
    if bits & 1:
        lane = 0
    return lane


@ti.data_oriented
class Packs:
    """Pack fields of one length and type, copied all in one kernel: one a field would take 0.1 s each to compile.
    count: that length as a field, see `ParticleFields.pack_count`. dtype: of the fields, as NumPy has it."""

    def __init__(self, fields: list, count, dtype: type) -> None:  # noqa: ANN001  (a taichi field)
        self.fields, self.count, self._dtype, self.on_gpu = fields, count, dtype, is_shared()
        self._place = {id(field): i for i, field in enumerate(fields)}
        self._launch_read = Launcher(self, Packs._read)

    def _rows(self, fields: list) -> np.ndarray:
        """Return for each field its row among the given ones, or -1."""
        places = {self._place.get(id(field)) for field in fields}
        if None in places or len(places) < len(fields):
            raise InvalidValue(f"Packs: {len(fields)} fields given; accepted: some of {len(self.fields)}, once each")
        rows = np.full(len(self.fields), -1, np.int32)
        rows[[self._place[id(field)] for field in fields]] = np.arange(len(fields))
        return rows

    def write(self, fields: list, values: np.ndarray) -> None:
        """Write values (k, packs, LANES) into k of the fields, as soon as these are laid out.
        Raises InvalidValue for values of another shape, and for a field that is none of these or given twice."""
        rows, accepted = self._rows(fields), (len(fields), *self.fields[0].shape, LANES)
        if values.shape != accepted:
            raise InvalidValue(f"Packs: values of shape {values.shape}; accepted: {accepted}")
        later(lambda: self._write(rows, np.ascontiguousarray(values, self._dtype)))

    def read(self, fields: list) -> np.ndarray:
        """Return values (k, packs, LANES) of k of the fields; raises InvalidValue as `write` does."""
        values = np.empty((len(fields), *self.fields[0].shape, LANES), self._dtype)
        self._launch_read(self._rows(fields), values)
        return values

    @ti.kernel
    def _write(self, rows: ti.types.ndarray(), values: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for slot in range(LANES * self.count[None]):
            q, l = slot // LANES, slot % LANES
            for i in ti.static(range(len(self.fields))):
                if rows[i] >= 0:
                    self.fields[i][q][l] = values[rows[i], q, l]

    @ti.kernel
    def _read(self, rows: ti.types.ndarray(), values: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(self.count[None]):
            for i in ti.static(range(len(self.fields))):
                if rows[i] >= 0:
                    for l in range(LANES):
                        values[rows[i], q, l] = self.fields[i][q][l]

    @ti.kernel
    def clear(self):
        """Set all fields to zero."""
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(self.count[None]):
            for i in ti.static(range(len(self.fields))):
                self.fields[i][q] = ti.Vector.zero(self.fields[i].dtype, LANES)
