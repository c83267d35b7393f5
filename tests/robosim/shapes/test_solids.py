"""Closed solids from curves, and the files of models that they make."""

import runpy

import numpy as np
import pytest

from robosim.base.resources import folder
from robosim.shapes.solids import loft, make_container_shell, revolve


def test_builders_give_closed_meshes_of_the_right_volume() -> None:
    sweep = runpy.run_path(str(folder("models") / "curves.py"))["sweep"]
    angle = np.linspace(-np.pi / 2, np.pi / 2, 41)
    ball = revolve(np.stack([np.cos(angle), np.sin(angle)], axis=1), 80)
    tube = sweep(np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 1.0], 9), np.full(9, 0.1), segments=80)
    box = loft([[[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]] for z in (0.0, 2.0)])
    for mesh, volume in ((ball, 4 / 3 * np.pi), (tube, np.pi * 0.01 * np.sqrt(2.0)), (box, 2.0)):
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(volume, rel=0.01)
    shell = make_container_shell((0.2, 0.15, 0.08))
    assert shell.is_watertight and shell.body_count == 1
