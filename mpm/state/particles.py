"""The state of all particles in packs of a few lanes, the layout that vector units are fast on."""

import numpy as np

from mpm.backend import is_shared, put, real_type, ti
from mpm.backend.launching import Launcher
from mpm.errors import InvalidValue
from mpm.materials.density import mass_around, share_at
from mpm.materials.material import stiffens_with_density
from mpm.scene.body import Body
from mpm.scene.features import Features
from mpm.scene.grid import Grid
from mpm.scene.initial_stress import state_under
from mpm.scene.validation import read_array
from mpm.state.packs import LANES, Packs

SPEED_LIMIT = 1.0  # cells that a particle may travel in a substep before the run counts as diverged
AT_WALL = 1e-4
"""Cells from the plane of a wall within which a particle counts as held there: no pressure brings it so close."""


class ParticleFields:
    """Fields of all particles; entry q, lane l is particle LANES q + l. Positions are relative to the grid's corner.
    counts: particles of each body. `fill` gives them a state."""

    def __init__(self, counts: tuple[int, ...], features: Features) -> None:
        real = real_type(features.precision)
        self._periodic = features.periodic
        self.counts, self.dtype = list(counts), np.float64 if features.precision == "f64" else np.float32
        packs = [-(-count // LANES) for count in self.counts]
        ends = np.cumsum(packs)
        self.ranges = [(int(end - n), int(end)) for n, end in zip(packs, ends)]
        """First and last + 1 pack of each body: a pack never mixes materials."""
        self.n_packs = int(ends[-1])
        self.n_lanes = self.n_packs * LANES  # lanes of all packs, padding included
        self.range_table = ti.Vector.field(3, ti.i32, len(counts))
        """First and last + 1 pack of each body, and the filled lanes of its last pack, for kernels."""
        filled = [count - LANES * (n - 1) for count, n in zip(self.counts, packs)]
        put(self.range_table, np.array([(*ends, lanes) for ends, lanes in zip(self.ranges, filled)], np.int32))
        self.pack_count = ti.field(ti.i32, ())
        """The number of packs, hidden from the compiler: it would unroll every copy of a few packs, which makes up half
        of what it compiles then."""
        put(self.pack_count, np.array(self.n_packs, np.int32))

        self.fastest, self.squares = ti.field(real, ()), ti.field(real, ())
        """Largest squared speed that the last gather found, and the sum of all, which is not finite if one is not."""
        self.halted = ti.field(ti.i32, ())
        """Row of the motion table, plus one, of the substep in which a particle was not finite, or faster than
        SPEED_LIMIT."""

        def pack_field():  # noqa: ANN202
            return ti.Vector.field(LANES, real, self.n_packs)

        self.x = [pack_field() for _ in range(3)]  # position relative to the grid's node (0, 0, 0) [m]
        self.remainder = [pack_field() for _ in range(3)] if features.precision == "f32" else []
        """Displacement [m] that is smaller than `Fields.quantum`, and not yet part of the position; none in double
        precision."""
        self.v = [pack_field() for _ in range(3)]  # velocity [m/s]
        self.C = [pack_field() for _ in range(9)]  # affine velocity [1/s], row by row
        self.e = [pack_field() for _ in range(6)] if features.tensor_state else []
        """b - I, with b the elastic left Cauchy-Green tensor."""
        self.j = pack_field() if features.volume_state else None  # J - 1, with J the volume ratio of a fluid
        self.vc = pack_field() if features.volume_correction else None
        """Volume correction: logarithmic expansion to be recovered."""
        self.around = pack_field() if features.density_state else None
        """Mass [kg] of the nodes around a particle, by its weights: what its stiffness is of, see `firmness`."""
        self.noted = pack_field() if features.density_state else None
        """That mass when the particle last took up velocities, see `take_up_density`."""
        self.acceleration = [pack_field() for _ in range(3)] if features.body_acceleration else []
        """Acceleration of a particle besides gravity [m/s^2]."""
        self.side = pack_field() if features.shells else None
        """Side of the closest shell, as plus or minus its collider's index plus one; 0 away from shells."""
        self.gap = pack_field() if features.shells else None
        """Signed distance to that shell at the start of the substep [m]."""
        self.rest = pack_field() if features.sleep else None
        """Time [s] for which the particle has been calm; it sleeps from the calm time on."""
        self.rest_place = [pack_field() for _ in range(4)] if features.sleep else []
        """Position [m] and change of volume at the begin of that time."""
        self.volume = pack_field()  # initial volume V0 [m^3]; zero in padding lanes
        self.half = pack_field() if features.static_colliders or features.moving_colliders else None
        """Half the edge of a particle's cube [m]; zero in padding lanes."""
        self.volumes = VolumeWriter(self)
        self.index = np.zeros(sum(counts), int)  # slot of each particle, in the order in which the bodies gave them
        state = [field for named in self.named_fields().values() for field in named]
        self.state_fields = state  # all fields of the state, in the order of `named_fields`: x, v and C first
        others = [field for field in (self.volume, self.half, self.gap) if field is not None]
        strain = [*self.e, *(field for field in (self.j, self.vc, self.around) if field is not None)]
        self.kept_strain = strain if features.sleep else []
        """Fields that the constitutive update changes, and that lanes which sleep keep."""
        self._all = Packs([*state, *others], self.pack_count, self.dtype)

    def fill(self, bodies: list[Body], grid: Grid) -> None:
        """Put the particles where their bodies have them, with no strain."""
        self.index = self._order(bodies, grid)
        volumes = [np.broadcast_to(np.asarray(body.volume, float), len(body.positions)) for body in bodies]
        velocities = [np.zeros((n, 3)) if body.velocities is None else body.velocities
                      for body, n in zip(bodies, self.counts)]
        unstrained = self.state_fields[len(self.x) + len(self.v):]
        self.write(unstrained, np.zeros((len(self.index), len(unstrained))))
        masses = np.concatenate([body.material.density * volume for body, volume in zip(bodies, volumes)])
        places = np.concatenate([body.positions for body in bodies]) - grid.origin
        around = mass_around(places / grid.cell, masses, np.where(self._periodic, grid.cells, 0))
        self._strain(bodies, around / grid.cell**3)
        self.write(self.x, places)
        self.write(self.v, np.concatenate(velocities))
        self.write([self.volume], np.concatenate(volumes)[:, None], padding=0.0)
        if self.half is not None:
            self.write([self.half], 0.5 * np.cbrt(np.concatenate(volumes))[:, None], padding=0.0)
        if self.gap is not None:
            self.write([self.gap], np.zeros((len(self.index), 1)))
        if self.around is not None:
            self.write([self.around, self.noted], np.stack([around, around], 1), padding=0.0)

    def _strain(self, bodies: list[Body], densities: np.ndarray) -> None:
        """Write the strain of bodies that begin under a stress; densities: around their particles [kg/m^3] (n,)."""
        ends = np.cumsum(self.counts)
        for fields, is_fluid in ((self.e, False), ([] if self.j is None else [self.j], True)):
            strain = np.zeros((len(self.index), len(fields)))
            for body, end in zip(bodies, ends):
                if body.stress is not None and (body.material.state == "volume") == is_fluid:
                    chosen = slice(end - len(body.positions), end)
                    firm = np.ones(len(body.positions))
                    if stiffens_with_density(body.material):
                        firm = share_at(densities[chosen], body.material.density)
                    strain[chosen] = state_under(body.material, body.stress / firm[:, None, None])
            if strain.any():
                self.write(fields, strain)

    def _order(self, bodies: list[Body], grid: Grid) -> np.ndarray:
        """Return slots (n_particles,) in the packs, sorted by cell: neighbours share cache lines."""
        slots = []
        for body, (begin, _) in zip(bodies, self.ranges):
            cells = np.floor((np.asarray(body.positions) - grid.origin) / grid.cell - 0.5).astype(int)
            order = np.lexsort(cells.T[::-1])
            slot = np.empty(len(order), int)
            slot[order] = begin * LANES + np.arange(len(order))
            slots.append(slot)
        return np.concatenate(slots)

    def write(self, fields: list, values: np.ndarray, padding: float | None = None) -> None:
        """Write values (n_particles, k) into k pack fields; see `pack`."""
        self._all.write(fields, self.pack(values, padding))

    def pack(self, values: np.ndarray, padding: float | None = None) -> np.ndarray:
        """Return values (n_particles, k) as k pack fields hold them (k, n_packs, LANES).
        padding: what padding lanes hold, or None: they repeat the last particle of their body."""
        packed = np.zeros((self.n_lanes, values.shape[1]), self.dtype)
        packed[self.index] = values
        for count, (begin, end) in zip(self.counts, self.ranges):
            used = begin * LANES + count
            packed[used : end * LANES] = packed[used - 1] if padding is None else padding
        return np.ascontiguousarray(packed.T).reshape(-1, self.n_packs, LANES)

    def read_snapshot(self, state: dict[str, np.ndarray], name: str) -> np.ndarray:
        """Return one of a snapshot's arrays; raises InvalidValue for one of another scene or what is not finite."""
        shape = (sum(self.counts), len(self.named_fields()[name]))
        if name == "remainder" and name not in state:  # of a solver in double precision, or of an older version
            return np.zeros(shape)
        values = read_array(state, name, shape)
        bad = np.flatnonzero(~np.isfinite(values).all(1))
        if len(bad):
            raise InvalidValue(f"load: {name} of {len(bad)} particles is not finite, first: particle {bad[0]} with "
                               f"{values[bad[0]].tolist()}; accepted: finite numbers")
        return values

    def read(self, fields: list) -> np.ndarray:
        """Return values (n_particles, k) of k pack fields, in the order in which the bodies gave their particles."""
        return self.unpack(self._all.read(fields))

    def unpack(self, packed: np.ndarray) -> np.ndarray:
        """Return values (k, n_packs, LANES) particle by particle (n_particles, k)."""
        return np.ascontiguousarray(packed.reshape(len(packed), -1)[:, self.index].T)

    def named_fields(self) -> dict[str, list]:
        """Return the fields of the state by the names that a snapshot has; x, v and C come first."""
        named = {"x": self.x, "v": self.v, "C": self.C}
        if self.acceleration:
            named["acceleration"] = self.acceleration
        if self.e:
            named["e"] = self.e
        if self.rest_place:
            named["rest_place"] = self.rest_place
        if self.remainder:
            named["remainder"] = self.remainder
        for name, field in (("j", self.j), ("vc", self.vc), ("around", self.around), ("noted", self.noted),
                            ("side", self.side),
                            ("rest", self.rest)):
            if field is not None:
                named[name] = [field]
        return named


@ti.data_oriented
class VolumeWriter:
    """Gives all particles of a body another initial volume; padding lanes stay empty."""

    def __init__(self, particles: ParticleFields) -> None:
        self._volume, self._half, self._ranges = particles.volume, particles.half, particles.ranges
        self.has_half, self.on_gpu = particles.half is not None, is_shared()
        self._numbers = np.zeros(2, particles.dtype)
        self._launch = Launcher(self, VolumeWriter._write)

    def set(self, body: int, volume: float, half: float) -> None:
        """Set volume [m^3] and half edge [m] of each of a body's particles."""
        self._numbers[:] = volume, half
        self._launch(*self._ranges[body], self._numbers)

    @ti.kernel
    def _write(self, begin: ti.i32, end: ti.i32, numbers: ti.types.ndarray()):
        ti.loop_config(serialize=not self.on_gpu)
        for q in range(begin, end):
            self.write_pack(q, numbers[0], numbers[1])

    @ti.func
    def write_pack(self, q, volume, half):
        """Set volume and half edge of one pack."""
        filled = ti.cast(self._volume[q] > 0.0, self._volume.dtype)  # one or zero in each lane
        self._volume[q] = filled * ti.cast(volume, self._volume.dtype)
        if ti.static(self.has_half):
            self._half[q] = filled * ti.cast(half, self._volume.dtype)
