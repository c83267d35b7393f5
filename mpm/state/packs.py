"""Fields of packs, copied all in one kernel: a kernel for each field would take a tenth of a second each to compile."""

import numpy as np

from mpm.backend import allocating, later, ti
from mpm.errors import InvalidValue

LANES = 4
"""Particles in a pack. Four fills the registers of common processors; eight spills them."""


@ti.data_oriented
class Packs:
    """Pack fields of one length and type. count: that length as a field, see `ParticleFields.pack_count`. dtype: of
    the fields, as NumPy has it."""

    def __init__(self, fields: list, count, dtype: type) -> None:  # noqa: ANN001  (a taichi field)
        self.fields, self.count, self._dtype = fields, count, dtype
        self._place = {id(field): i for i, field in enumerate(fields)}

    def _rows(self, fields: list) -> np.ndarray:
        """For each of all fields its row among the given ones, or -1; raises InvalidValue for a field that is none of
        these, or given twice."""
        places = {self._place.get(id(field)) for field in fields}
        if None in places or len(places) < len(fields):
            raise InvalidValue(f"Packs: {len(fields)} fields given; accepted: some of {len(self.fields)}, once each")
        rows = np.full(len(self.fields), -1, np.int32)
        rows[[self._place[id(field)] for field in fields]] = np.arange(len(fields))
        return rows

    def write(self, fields: list, values: np.ndarray) -> None:
        """Values (k, packs, LANES) into k of the fields, as soon as these are laid out; raises InvalidValue for values
        of another shape."""
        rows, wanted = self._rows(fields), (len(fields), *self.fields[0].shape, LANES)
        if values.shape != wanted:
            raise InvalidValue(f"Packs: values of shape {values.shape}; accepted: {wanted}")
        later(lambda: self._write(rows, np.ascontiguousarray(values, self._dtype)))

    def read(self, fields: list) -> np.ndarray:
        """Values (k, packs, LANES) of k of the fields."""
        values = np.empty((len(fields), *self.fields[0].shape, LANES), self._dtype)
        self._read(self._rows(fields), values)
        return values

    def clear(self) -> None:
        """Set all fields to zero."""
        self._clear()

    @ti.kernel
    def _write(self, rows: ti.types.ndarray(), values: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in ti.static(range(len(self.fields))):
                if rows[i] >= 0:
                    for slot in range(LANES * self.count[None]):
                        q, l = slot // LANES, slot % LANES
                        self.fields[i][q][l] = values[rows[i], q, l]

    @ti.kernel
    def _read(self, rows: ti.types.ndarray(), values: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in ti.static(range(len(self.fields))):
                if rows[i] >= 0:
                    for slot in range(LANES * self.count[None]):
                        q, l = slot // LANES, slot % LANES
                        values[rows[i], q, l] = self.fields[i][q][l]

    @ti.kernel
    def _clear(self):
        ti.loop_config(serialize=True)
        for q in range(self.count[None]):
            for i in ti.static(range(len(self.fields))):
                self.fields[i][q] = ti.Vector.zero(self.fields[i].dtype, LANES)


@ti.data_oriented
class Snapshot:
    """A copy of pack fields."""

    def __init__(self, packs: Packs) -> None:
        self.count, self.fields = packs.count, packs.fields
        with allocating():
            self.copies = [ti.Vector.field(LANES, field.dtype, field.shape) for field in self.fields]

    @ti.kernel
    def keep(self):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.copy()

    @ti.func
    def copy(self):
        """As `keep`, within a launch."""
        for q in range(self.count[None]):
            for i in ti.static(range(len(self.fields))):
                self.copies[i][q] = self.fields[i][q]

    @ti.kernel
    def rewind(self):
        ti.loop_config(serialize=True)
        for q in range(self.count[None]):
            for i in ti.static(range(len(self.fields))):
                self.fields[i][q] = self.copies[i][q]
