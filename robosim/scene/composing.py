"""Containers and their grains, for those who compose a MuJoCo scene of their own."""

import mujoco
import numpy as np
from numpy.typing import NDArray

import mpm
from robosim.config.materials import Law
from robosim.config.scene import ContainerConfig
from robosim.scene.grains import CONTAINER_SPACING, CONTAINER_WALL, fill_container, is_in_container
from robosim.scene.models import container_shape
from robosim.shapes.rigid_models import add_container_body

Array = NDArray[np.float64]


class Container:
    """A container that stands in a scene: its body, its collider and its grains.
    name: of its body; of models/containers, too, unless keys give a model, size, radius with height, or mesh. keys: of
    `robosim.config.scene.ContainerConfig`, such as position. Raises ConfigError for a wrong mesh, and ValueError
    (pydantic.ValidationError) for wrong keys."""

    def __init__(self, name: str, **keys: object) -> None:
        self.name, self.config = name, ContainerConfig.model_validate(keys)
        self.shape = container_shape(name, self.config)
        self.pose = self.config.pose
        """Of its frame in the world."""

    @property
    def volume(self) -> float:
        """What it holds up to its rim [m^3]."""
        low, high = self.shape.bounds
        points = mpm.sample_box(low, high, float(np.cbrt(np.prod(high - low) / 1e5)))
        return float(np.prod(high - low) * self.shape.between_walls(points).mean())

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add its body, what is seen and what collides, to a specification."""
        body = add_container_body(spec, self.name, self.shape)
        body.pos, body.quat = self.pose.position, self.pose.quaternion

    def collider(self, cell: float, friction: float = 0.5) -> mpm.Collider:
        """Make its static collider for a grid of cells of `cell` [m]; its walls are thickened outward."""
        return mpm.Collider(self.shape.distance(CONTAINER_WALL * cell, CONTAINER_SPACING), static=True,
                            friction=friction, pose=self.pose)

    def fill(self, law: Law, height: float, spacing: float, seed: int = 0) -> mpm.Body:
        """Make grains up to a height [m] above its floor, about `spacing` [m] apart, at rest under their own weight."""
        local, volume = fill_container(self.shape, height, spacing, 2.0 * spacing, np.random.default_rng(seed))
        positions = self.pose.apply(local)
        return mpm.Body(law, positions, volume=volume, stress=mpm.geostatic_stress(positions, volume, law))

    def holds(self, positions: Array) -> NDArray[np.bool_]:
        """Return which of positions (n, 3) [m] are in it, or in the heap on it (n,)."""
        return is_in_container(positions, self.name, self.config)
