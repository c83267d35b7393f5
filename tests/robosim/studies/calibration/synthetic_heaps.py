"""Files of measurements of heaps whose numbers are known: simulated with other places of the particles, with noise."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from robosim.config.materials import load_material, overridden
from robosim.studies.calibration.flows import simulate_heap
from robosim.studies.calibration.measurements import HeapExperiment
from robosim.studies.verification.cases.beds import rim

SEED = 424_242  # of the heaps' particles and of the noise


def write_heaps(folder: Path, *, material: str, numbers: dict[str, float], sought: dict[str, list[float]],
                heights: dict[str, float], held_out: tuple[str, ...] = (), radius: float = 0.04, noise: float = 0.002,
                cells: int = 8, pixel: float = 0.002, seed: int = SEED, **more: Any) -> Path:
    """Write height maps [mm] of columns and a file of measurements that names them; return its path.
    heights: of the columns [m] by name. cells: of the grid that the heaps come from. more: keys of every heap."""
    card = overridden(load_material(material), numbers)
    rng, experiments = np.random.default_rng(seed), {}
    for k, (name, height) in enumerate(heights.items()):
        table = {"kind": "heap", "data": f"{name}.npy", "unit": "mm", "scale": pixel, "noise": noise, "radius": radius,
                 "height": height, "floor_friction": 0.5, "held_out": name in held_out, **more}
        heap = HeapExperiment.model_validate({**table, "cells": cells})
        half = int(np.ceil(1.25 * rim(radius, height / radius) / pixel))
        axis = np.arange(-half, half + 1) * pixel
        distances = np.hypot(*np.meshgrid(axis, axis, indexing="ij"))
        map_ = simulate_heap(heap, card, 0.5, distances.ravel(), seed + k).reshape(distances.shape)
        np.save(folder / f"{name}.npy", 1e3 * (map_ + rng.normal(0.0, noise, map_.shape)))
        experiments[name] = table
    path = folder / "measurements.yaml"
    path.write_text(yaml.safe_dump({"description": f"synthetic heaps of {material}", "material": material,
                                    "sought": sought, "experiments": experiments}, sort_keys=False))
    return path
