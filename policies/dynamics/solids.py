"""Rigid bodies of a scene as points on their surfaces."""

from typing import Any, NamedTuple

import numpy as np

POINTS = 150
"""Largest number of points of a body."""
SAMPLES = 200_000
"""Random points in a body's bounding box, of which those near its surface are kept."""
NEAR_SURFACE = 0.02
"""Largest distance from the surface, as a fraction of the bounding box's diagonal."""


class Solid(NamedTuple):
    """A rigid body."""

    points: np.ndarray
    """(n, 3) near its surface [m], in its own frame if it moves, else in world axes."""
    moves: bool


def sample_solids(env: Any) -> list[Solid]:
    """Return the rigid bodies of an environment's scene: the tool, which moves, and the fixed ones."""
    solids, rng = [], np.random.default_rng(0)
    for index, collider in enumerate(env.solver.colliders):
        lower, upper = collider.sdf.bounds
        samples = rng.uniform(lower, upper, (SAMPLES, 3))
        is_near = np.abs(collider.sdf.distance(samples)) < NEAR_SURFACE * np.linalg.norm(upper - lower)
        points = samples[is_near][:POINTS]
        pose = env.solver.collider_pose(index)
        solids.append(Solid(points if index == 0 else pose.apply(points), index == 0))
    return solids
