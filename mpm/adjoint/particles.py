"""Bars of the particles' state."""

from mpm.backend import real_type, ti
from mpm.particles import LANES, ParticleFields


class ParticleBars:
    """A field for the bar of every field of the state, under the same names, zero at first."""

    def __init__(self, particles: ParticleFields, precision: str) -> None:
        def like(fields: list) -> list:
            return [ti.Vector.field(LANES, real_type(precision), particles.n_packs) for _ in fields]

        self.x, self.v, self.C, self.e = like(particles.x), like(particles.v), like(particles.C), like(particles.e)
        self.j = like([0])[0] if particles.j is not None else None
        self.vc = like([0])[0] if particles.vc is not None else None
        self.ranges, self.n_packs = particles.ranges, particles.n_packs

    def named_fields(self) -> dict[str, list]:
        """The fields, as `ParticleFields` names them."""
        named = {"x": self.x, "v": self.v, "C": self.C}
        if self.e:
            named["e"] = self.e
        return named | {name: [field] for name, field in (("j", self.j), ("vc", self.vc)) if field is not None}

    def clear(self) -> None:
        """Set all to zero."""
        for fields in self.named_fields().values():
            for field in fields:
                field.fill(0.0)
