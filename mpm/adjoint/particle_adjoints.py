"""Adjoints of the particles' state."""

import numpy as np

from mpm.backend import real_type, ti
from mpm.state.packs import LANES, Packs
from mpm.state.particles import ParticleFields


class ParticleAdjoints:
    """A field for the adjoint of every field of the state, under the same names, zero at first.
    The remainder has none: it is part of the position, whose derivative does not know the resolution."""

    def __init__(self, particles: ParticleFields, precision: str) -> None:
        self._named = {name: [ti.Vector.field(LANES, real_type(precision), particles.n_packs) for _ in fields]
                       for name, fields in particles.named_fields().items() if name != "remainder"}
        self.x, self.v, self.C = (self._named[name] for name in ("x", "v", "C"))
        self.e = self._named.get("e", [])
        self.j, self.vc = (self._named.get(name, [None])[0] for name in ("j", "vc"))
        every = [field for fields in self._named.values() for field in fields]
        self.packs = Packs(every, particles.pack_count, np.float64 if precision == "f64" else np.float32)

    def named_fields(self) -> dict[str, list]:
        """Return the fields by the names of `ParticleFields`."""
        return self._named

    def clear(self) -> None:
        """Set all to zero."""
        self.packs.clear()
