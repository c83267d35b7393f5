"""Losses of a rollout. A loss is one small function: states after some steps in, value and derivatives out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mpm.geometry.shape import Shape

NEARBY = 1e-4
"""Step [m] of the differences that give a distance's slope: small against a tool, large against single precision."""


class RolloutStates(NamedTuple):
    """Particles and tool after some of a rollout's steps."""

    steps: np.ndarray
    """Numbers of the steps (k,), the first being 1."""
    x: np.ndarray
    """Positions [m] (k, n, 3), in the order in which the bodies gave their particles."""
    v: np.ndarray
    """Velocities [m/s] (k, n, 3)."""
    places: np.ndarray
    """Positions of the tool [m] (k, 3)."""
    axes: np.ndarray
    """Rotation matrices of the tool (k, 3, 3)."""


class LossGradient(NamedTuple):
    """Value of a loss over some steps, and its derivatives; None stands for zeros."""

    value: float
    x: np.ndarray | None = None
    """(k, n, 3)"""
    v: np.ndarray | None = None
    """(k, n, 3)"""
    pose: np.ndarray | None = None
    """By the tool's position and by a turn of it in world axes (k, 6)."""


Loss = Callable[[RolloutStates], LossGradient]
"""A loss sums over steps, so that they can be given in any grouping."""


@dataclass(frozen=True)
class WeightedDistance:
    """Sum over steps and particles of the weighted Manhattan distance to a goal, times `scale`.
    goal: [m] (3,). weights: (3,). chosen: indices of the particles that count; None: all. scale: factor per step
    (n_steps,) or a number. nearest: only so many of the particles count, those closest to the goal at each step."""

    goal: np.ndarray
    weights: np.ndarray
    chosen: np.ndarray | None = None
    scale: float | np.ndarray = 1.0
    nearest: int | None = None

    def __call__(self, states: RolloutStates) -> LossGradient:
        chosen = np.arange(states.x.shape[1]) if self.chosen is None else self.chosen
        offset = states.x[:, chosen] - self.goal
        factor = np.broadcast_to(scale_at(self.scale, states.steps)[:, None], offset.shape[:2])
        distance = np.abs(offset) @ np.asarray(self.weights, float)
        if self.nearest is not None:
            last = np.partition(distance, self.nearest - 1, axis=1)[:, self.nearest - 1, None]
            factor = factor * (distance <= last)
        bar = np.zeros(states.x.shape)
        bar[:, chosen] = factor[..., None] * np.sign(offset) * self.weights
        return LossGradient(float(np.sum(factor * distance)), x=bar)


@dataclass(frozen=True)
class Above:
    """Sum over steps and particles of the height [m] above a plane at z = height, times `scale`: draws grains down."""

    height: float
    chosen: np.ndarray | None = None
    scale: float | np.ndarray = 1.0

    def __call__(self, states: RolloutStates) -> LossGradient:
        chosen = np.arange(states.x.shape[1]) if self.chosen is None else self.chosen
        rise = states.x[:, chosen, 2] - self.height
        factor = scale_at(self.scale, states.steps)[:, None] * (rise > 0)
        bar = np.zeros(states.x.shape)
        bar[:, chosen, 2] = factor
        return LossGradient(float(np.sum(factor * rise)), x=bar)


@dataclass(frozen=True)
class Attraction:
    """Sum over steps of the distance [m] from a point of the tool to the mean of chosen grains, beyond `rest` [m]:
    draws a tool that has not met its material. point: in the tool's frame [m] (3,)."""

    point: np.ndarray
    chosen: np.ndarray | None = None
    rest: float = 0.0
    scale: float | np.ndarray = 1.0

    def __call__(self, states: RolloutStates) -> LossGradient:
        chosen = np.arange(states.x.shape[1]) if self.chosen is None else self.chosen
        arm = states.axes @ np.asarray(self.point, float)
        offset = states.places + arm - states.x[:, chosen].mean(1)
        distance = np.linalg.norm(offset, axis=1)
        factor = scale_at(self.scale, states.steps) * (distance > self.rest)
        pull = (factor / np.maximum(distance, 1e-12))[:, None] * offset
        bar = np.zeros(states.x.shape)
        bar[:, chosen] = -pull[:, None] / len(chosen)
        pose = np.concatenate([pull, np.cross(arm, pull)], 1)
        return LossGradient(float(np.sum(factor * (distance - self.rest))), x=bar, pose=pose)


@dataclass(frozen=True)
class Clear:
    """Sum over steps of how much nearer [m] than `margin` the nearest of fixed points is to the tool, or how deep in
    it, times `scale`: keeps a tool off what stands there. points: [m] (n, 3). shape: the tool's, in its frame."""

    points: np.ndarray
    shape: Shape
    margin: float
    scale: float | np.ndarray = 1.0

    def __call__(self, states: RolloutStates) -> LossGradient:
        arms = self.points - states.places[:, None]
        local = arms @ states.axes
        near = np.linalg.norm(local, axis=2) < self.shape.radius + self.margin
        distance = np.full(near.shape, self.margin)
        distance[near] = self.shape.distance(local[near])
        first, each = distance.argmin(1), np.arange(len(arms))
        deep = np.maximum(self.margin - distance[each, first], 0.0)
        factor = scale_at(self.scale, states.steps) * (deep > 0)
        steps = NEARBY * np.eye(3)
        ends = [self.shape.distance(local[each, first] + way) - self.shape.distance(local[each, first] - way)
                for way in steps]
        normal = np.einsum("kij,jk->ki", states.axes, np.array(ends)) / (2.0 * NEARBY)
        pose = factor[:, None] * np.concatenate([normal, np.cross(arms[each, first], normal)], 1)
        return LossGradient(float(np.sum(factor * deep)), pose=pose)


@dataclass(frozen=True)
class Turned:
    """|angle - target| [rad] at the end (`step`), the angle by which the tool has turned about its lateral axis y since
    the start, `axes` (3, 3): atan2 of the turned x axis, as the sub-tasks read it."""

    axes: np.ndarray
    target: float
    step: int
    scale: float = 1.0

    def __call__(self, states: RolloutStates) -> LossGradient:
        pose = np.zeros((len(states.steps), 6))
        value = 0.0
        for k in np.flatnonzero(states.steps == self.step):
            x0, z = self.axes[:, 0], states.axes[k][:, 2]
            x = states.axes[k][:, 0]
            sine, cosine = x0 @ z, x0 @ x
            error = np.arctan2(sine, cosine) - self.target
            error = (error + np.pi) % (2 * np.pi) - np.pi
            value += self.scale * abs(error)
            # a turn w changes z by w x z: d(x0 . z) = w . (z x x0)
            slope = (cosine * np.cross(z, x0) - sine * np.cross(x, x0)) / (sine**2 + cosine**2)
            pose[k, 3:] = self.scale * np.sign(error) * slope
        return LossGradient(value, pose=pose)


@dataclass(frozen=True)
class Sum:
    """Several losses together."""

    losses: tuple[Loss, ...]

    def __call__(self, states: RolloutStates) -> LossGradient:
        parts = [loss(states) for loss in self.losses]
        return LossGradient(sum(part.value for part in parts), *[added([part[i] for part in parts]) for i in (1, 2, 3)])


def added(arrays: list[np.ndarray | None]) -> np.ndarray | None:
    """Sum of what is there."""
    present = [array for array in arrays if array is not None]
    return sum(present[1:], present[0]) if present else None


def scale_at(scale: float | np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the factors (k,) of steps (k,)."""
    return np.full(len(steps), scale) if np.ndim(scale) == 0 else np.asarray(scale, float)[steps - 1]
