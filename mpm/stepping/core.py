"""The core of a solver, which batches and rollouts share: scene, fields, readings, settings, paths, checkpoints."""

from dataclasses import replace

import numpy as np

from mpm.backend import default_precision, is_shared, ti
from mpm.backend.assembly import Tenure
from mpm.boundaries.node_contact import cache_static_contact
from mpm.materials.stable_step import choose_step
from mpm.motion.collider_paths import ColliderPaths
from mpm.motion.mobility_table import MobilityTable
from mpm.observers.reading_kernels import Sample
from mpm.observers.readings import Progress, Readings
from mpm.observers.region_counter import RegionCounter
from mpm.scene.body import largest_volume
from mpm.scene.features import features_of
from mpm.scene.grid import ROUNDING
from mpm.scene.scene import Numerics, Scene
from mpm.scene.validation import read_array
from mpm.state.fields import Fields, allocate_fields, count_parts, fill_fields, scene_key
from mpm.state.memory import check_memory
from mpm.stepping.rollback import Rollback
from mpm.stepping.settings import Settings
from mpm.stepping.stride import choose_interval, longest_stride


class Core:
    """The parts of a solver of one scene.
    numerics: with precision and integrator chosen. has_accelerations: whether particles have own accelerations."""

    def __init__(self, scene: Scene, numerics: Numerics, has_accelerations: bool) -> None:
        self.scene, self.numerics, self._has_accelerations = scene, numerics, has_accelerations
        self.precision, self.sleep = numerics.precision or "", float(numerics.sleep)
        materials = [body.material for body in scene.bodies]
        volume = largest_volume(scene.bodies)
        self.dt = choose_step(numerics.dt, scene.grid.cell, materials, volume)  # largest substep [s]
        self.counter: RegionCounter | None = None
        self.sample: Sample | None = None
        interval = choose_interval(numerics.transfer_interval, scene, materials)
        self.features = features_of(scene, numerics, body_acceleration=has_accelerations,
                                    strides=longest_stride(interval, self.dt) > 1)
        self.mobility = MobilityTable(self.features.mobile)
        self.paths = ColliderPaths(scene, self.features, self.mobility)
        self.tenure = self._take_fields()
        self.progress = Progress(self.fields.rows.count, self.dt)
        self.readings = Readings(self.tenure, scene, self.progress)
        self.rollback = Rollback(self.readings, self.paths)
        self.settings = Settings(self.readings, self.rollback, self.dt, self.sleep)
        with default_precision(self.precision):
            fill_fields(self.fields, scene)
            self.settings.wake()
            self._cache_static_contact()

    def _take_fields(self) -> Tenure:
        """Take over the fields of an equal scene, or allocate them."""
        scene, features = self.scene, self.features
        counts = tuple(len(body.positions) for body in scene.bodies)
        check_memory(scene.grid, counts, features, count_parts(features))
        tenure = Tenure(scene_key(scene, features), self.precision)
        if "fields" not in tenure.assembly.shared:
            for collider in scene.colliders:
                collider.sdf.lay_out()
        fields = tenure.assembly.share("fields", lambda: allocate_fields(scene, features))
        scene.colliders[:] = [replace(given, sdf=ready.sdf) for given, ready in zip(scene.colliders, fields.colliders)]
        return tenure

    def _cache_static_contact(self) -> None:
        """Look the static colliders up at every node."""
        fields, static = self.fields, self.features.static_colliders
        origin, cell = ti.Vector(self.scene.grid.origin, ti.f64), self.scene.grid.cell
        for i in static:
            collider = self.scene.colliders[i]
            place = np.concatenate([collider.pose.position, collider.pose.matrix.ravel()])
            cache_static_contact(fields.static_contact, collider.sdf, i, i == static[0], place, origin, cell,
                                 is_shared())

    @property
    def fields(self) -> Fields:
        """All run-time fields; raises InvalidValue once the solver is closed."""
        return self.tenure.assembly.shared["fields"]

    @property
    def dtype(self) -> type:
        """NumPy's type of the field's numbers."""
        return self.fields.dtype

    @property
    def transfer_interval(self) -> float:
        """Longest stride [s] with the current materials and colliders."""
        return choose_interval(self.numerics.transfer_interval, self.scene,
                               [body.material for body in self.scene.bodies])

    def state(self) -> dict[str, np.ndarray]:
        """Return the state, for a bitwise identical continuation; it has no parameters such as gravity."""
        fields, particles = self.fields, self.fields.particles
        arrays = {name: particles.read(named) for name, named in particles.named_fields().items()}
        poses = np.array([np.concatenate(pose) for pose in self.paths.poses]).reshape(-1, 7)
        boundaries = {boundary.name: boundary.read() for boundary in fields.boundary_states}
        return arrays | {"time": np.array(self.progress.time), "steps": np.array(self.progress.steps), "poses": poses,
                         **self.mobility.save(), **boundaries}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Load a state of this solver, or of one made from the same scene.
        Raises InvalidValue, and changes nothing, for a state of another scene."""
        particles, boundaries, grid = self.fields.particles, self.fields.boundary_states, self.scene.grid
        named, poses = particles.named_fields(), self.paths.read_snapshot(state)
        arrays = [particles.read_snapshot(state, name) for name in named]
        grid.check_inside(arrays[0] + grid.origin, "load: ", ROUNDING)
        time, steps = float(read_array(state, "time", ())), int(read_array(state, "steps", ()))
        boundary_values = [boundary.read_snapshot(state) for boundary in boundaries]
        self.mobility.restore(state)
        self.rollback.store_pending()
        for boundary, packs in zip(boundaries, boundary_values):
            boundary.write(packs)
        for fields, values in zip(named.values(), arrays):
            particles.write(fields, values)
        self.rollback.adopt_state(poses, time, steps)
