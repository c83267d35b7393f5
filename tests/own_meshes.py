"""A ladle and bowls, as a laboratory would draw them: files of millimetres."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

BOWL_MM, WALL_MM = 28.0, 1.5
"""Inner radius and wall of the ladle's bowl."""
HANDLE = {"head": [-0.060, 0.0, 0.0285], "end": [-0.1487, 0.0, 0.1172]}
"""Line of the ladle's handle [m]."""
HANDLE_MM = 8.0
"""Radius of the handle."""


def half_sphere(radius: float, wall: float) -> trimesh.Trimesh:
    """Return a bowl whose rim is at z = 0, grown outward by its wall, closed."""
    angle = np.linspace(0.0, np.pi / 2.0, 24)
    arc = np.column_stack([np.sin(angle), -np.cos(angle)])
    return trimesh.creation.revolve(np.concatenate([(radius + wall) * arc, radius * arc[::-1]]), sections=64)


def write_ladle(path: Path, sheet: bool = False) -> Path:
    """Write a half sphere with a rod as its handle, which overlaps the wall; sheet: the middle of its wall alone."""
    start, along = np.array([-28.5, 0.0, -3.0]), np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0)
    rod = trimesh.creation.cylinder(HANDLE_MM, segment=[start, start + 170.0 * along], sections=32)
    head = half_sphere(BOWL_MM, WALL_MM)
    if sheet:
        angle = np.linspace(0.0, np.pi / 2.0, 24)
        arc = (BOWL_MM + 0.5 * WALL_MM) * np.column_stack([np.sin(angle), -np.cos(angle)])
        head = trimesh.creation.revolve(arc, sections=64)
    trimesh.util.concatenate([head, rod]).export(path)
    return path


def ladle_keys(mesh: Path | str, **changes: Any) -> dict[str, Any]:
    return {"name": "ladle", "mesh": str(mesh), "scale": 1e-3, "mass": 0.12, "handle": HANDLE} | changes


def write_bowl(path: Path, radius: float = 80.0, wall: float = 3.0) -> Path:
    """Write a half sphere that stands on a foot, with its rim at radius + wall."""
    bowl = half_sphere(radius, wall).apply_translation([0.0, 0.0, radius + wall])
    foot = trimesh.creation.cylinder(0.4 * radius, 8.0, sections=48).apply_translation([0.0, 0.0, 4.0])
    trimesh.util.concatenate([bowl, foot]).export(path)
    return path
