"""States of the particles, kept side by side on the device."""

from mpm.backend import real_type, ti
from mpm.state.packs import LANES
from mpm.state.particles import ParticleFields

MOVING = 15
"""Fields of x, v and C, which come first in a state."""


@ti.data_oriented
class History:
    """`slots` states of the particles."""

    def __init__(self, particles: ParticleFields, precision: str, slots: int) -> None:
        self.fields = [field for fields in particles.named_fields().values() for field in fields]
        self.pack_count = particles.pack_count
        self.kept = ti.Vector.field(LANES, real_type(precision), (slots, len(self.fields), particles.n_packs))

    @staticmethod
    def bytes_per_state(particles: ParticleFields, precision: str) -> int:
        """Memory of one state."""
        fields = sum(len(fields) for fields in particles.named_fields().values())
        return fields * particles.n_packs * LANES * (8 if precision == "f64" else 4)

    @ti.func
    def store(self, slot):
        """Keep the present state."""
        for q in range(self.pack_count[None]):
            for i in ti.static(range(len(self.fields))):
                self.kept[slot, i, q] = self.fields[i][q]

    @ti.func
    def load(self, slot):
        """Return to a state."""
        for q in range(self.pack_count[None]):
            for i in ti.static(range(len(self.fields))):
                self.fields[i][q] = self.kept[slot, i, q]

    @ti.func
    def load_strains(self, slot):
        """Return to what a state's laws remember."""
        for q in range(self.pack_count[None]):
            for i in ti.static(range(MOVING, len(self.fields))):
                self.fields[i][q] = self.kept[slot, i, q]

    @ti.kernel
    def keep(self, slot: ti.i32):
        """Keep the present state, from outside a kernel."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.store(slot)

    @ti.kernel
    def copy(self, source: ti.template(), from_slot: ti.i32, to_slot: ti.i32):
        """Take over a state of another history."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for q in range(self.pack_count[None]):
                for i in ti.static(range(len(self.fields))):
                    self.kept[to_slot, i, q] = source.kept[from_slot, i, q]
