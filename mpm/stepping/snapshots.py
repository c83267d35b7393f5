"""States set aside on the device: the one way in which checkpoints, histories and batches keep them."""

from typing import Any

from mpm.backend import is_shared, ti
from mpm.state.packs import LANES
from mpm.state.sleepers import ALL_LANES, Sleepers


@ti.data_oriented
class StateBank:
    """Copies of pack fields, and of flags of single particles, in numbered slots; made inside `backend.allocating`.
    fields: pack fields of one length and type. count: that length, as a field. slots: how many states there is room
    for. flags: fields (n_lanes,) of 8-bit integers that belong to a state, or none. sleepers: with one slot, packs that
    have slept since they were stored are not stored again."""

    def __init__(self, fields: list, count: Any, slots: int, flags: list | None = None,
                 sleepers: Sleepers | None = None) -> None:
        self.fields, self.count, self.slots, self.flags = fields, count, slots, list(flags or [])
        self.packs = fields[0].shape[0] if fields else 0
        self.lanes = self.flags[0].shape[0] if self.flags else 0
        self.states = ti.Vector.field(LANES, fields[0].dtype, (slots, len(fields), self.packs)) if fields else None
        self.skips, self.sleepers = sleepers is not None, sleepers
        self.stored = ti.field(ti.i32, self.packs) if self.skips else None
        """The pack's `Sleepers.version` when it was stored asleep."""
        self.flag_states = ti.field(ti.i8, (slots, len(self.flags), self.lanes)) if self.flags else None

    @staticmethod
    def bytes_per_state(fields: list, precision: str) -> int:
        """Return the memory [bytes] that one state of pack fields takes."""
        return sum(field.shape[0] for field in fields) * LANES * (8 if precision == "f64" else 4)

    # inside a launch -------------------------------------------------------------------------------------------------
    @ti.func
    def store(self, slot):
        """Copy the present state into a slot."""
        if ti.static(self.skips):
            self.store_changed(slot)
        else:
            for i in ti.static(range(len(self.fields))):
                for q in range(self.count[None]):
                    self.states[slot, i, q] = self.fields[i][q]
        for i in ti.static(range(len(self.flags))):
            for lane in range(self.lanes):
                self.flag_states[slot, i, lane] = self.flags[i][lane]

    @ti.func
    def store_changed(self, slot):
        """Copy the packs that are not as the slot has them already."""
        for q in range(self.count[None]):
            if self.stored[q] != self.sleepers.version[q]:
                for i in ti.static(range(len(self.fields))):
                    self.states[slot, i, q] = self.fields[i][q]
                if self.sleepers.lanes_asleep[q] == ALL_LANES:
                    self.stored[q] = self.sleepers.version[q]

    @ti.func
    def restore(self, slot):
        """Make a slot's state the present one."""
        for i in ti.static(range(len(self.fields))):
            for q in range(self.count[None]):
                self.fields[i][q] = self.states[slot, i, q]
        for i in ti.static(range(len(self.flags))):
            for lane in range(self.lanes):
                self.flags[i][lane] = self.flag_states[slot, i, lane]

    @ti.func
    def restore_from(self, slot, first: ti.template()):
        """Restore the pack fields from number `first` on."""
        for q in range(self.count[None]):
            for i in ti.static(range(first, len(self.fields))):
                self.fields[i][q] = self.states[slot, i, q]

    # from outside ----------------------------------------------------------------------------------------------------
    @ti.kernel
    def store_now(self, slot: ti.i32):
        """Copy the present state into a slot."""
        if ti.static(is_shared()):
            for q in range(self.count[None]):
                for i in ti.static(range(len(self.fields))):
                    self.states[slot, i, q] = self.fields[i][q]
            for lane in range(self.lanes):
                for i in ti.static(range(len(self.flags))):
                    self.flag_states[slot, i, lane] = self.flags[i][lane]
        else:
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.store(slot)

    @ti.kernel
    def restore_now(self, slot: ti.i32):
        """Make a slot's state the present one."""
        if ti.static(is_shared()):
            for q in range(self.count[None]):
                for i in ti.static(range(len(self.fields))):
                    self.fields[i][q] = self.states[slot, i, q]
            for lane in range(self.lanes):
                for i in ti.static(range(len(self.flags))):
                    self.flags[i][lane] = self.flag_states[slot, i, lane]
        else:
            ti.loop_config(serialize=True)
            for _ in range(1):
                self.restore(slot)

    @ti.kernel
    def write(self, slot: ti.i32, values: ti.types.ndarray()):
        """Write values (fields, packs, LANES) into a slot; its flags are cleared."""
        ti.loop_config(serialize=True)
        for i in range(values.shape[0]):
            for q in range(values.shape[1]):
                for l in ti.static(range(LANES)):
                    self.states[slot, i, q][l] = values[i, q, l]
        ti.loop_config(serialize=True)
        for lane in range(self.lanes):
            for i in ti.static(range(len(self.flags))):
                self.flag_states[slot, i, lane] = 0

    @ti.kernel
    def copy_from(self, source: ti.template(), from_slot: ti.i32, to_slot: ti.i32):
        """Copy a slot of another bank, or of this one, into a slot of this bank."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for q in range(self.count[None]):
                for i in ti.static(range(len(self.fields))):
                    self.states[to_slot, i, q] = source.states[from_slot, i, q]
