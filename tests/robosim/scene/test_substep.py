"""The substep of a scene: it divides an advance into as few as its bound allows."""

import numpy as np
import pytest

import mpm
from robosim.config.materials import load_material
from robosim.config.rehearsal import load_rehearsal
from robosim.scene.field import FITTED, build_field, choose_substep, fitted_step
from robosim.tasks.task import load_task

SALT = load_material("salt").make_law()


def test_substeps_are_the_fewest_that_divide_an_advance() -> None:
    """None is longer than what is tolerated, and with one less they would be."""
    rng = np.random.default_rng(0)
    for duration, default in zip(10.0 ** rng.uniform(-4, -1, 200), 10.0 ** rng.uniform(-5, -3, 200)):
        dt = fitted_step(duration, default)
        assert duration / dt == pytest.approx(count := round(duration / dt), rel=1e-12)
        assert dt <= FITTED * default * (1 + 1e-12)
        assert count == 1 or duration / (count - 1) > FITTED * default


def test_the_spoon_takes_three_in_an_advance() -> None:
    spoon = load_rehearsal("spoon")
    field = build_field(spoon, SALT, mpm.Pose([0.1, 0.1, 0.2], [1, 0, 0, 0]))
    assert field.dt == pytest.approx(spoon.advance_dt / 3)


@pytest.mark.parametrize("name", ["SpoonScoop", "ShovelMove"])
def test_a_field_takes_the_substep_that_its_scene_chooses(name: str) -> None:
    task = load_task(name)
    assert build_field(task, SALT, task.start.pose).dt == pytest.approx(choose_substep(task, SALT), rel=1e-9)
