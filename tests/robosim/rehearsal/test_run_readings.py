"""What is read of a run: quaternions whose signs do not jump, and what counts as delivered, retained or spilled."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mpm
from robosim.config.rehearsal import load_rehearsal
from robosim.rehearsal.mass_balance import compute_fractions
from robosim.rehearsal.metrics import find_missed, get_bounds
from robosim.rehearsal.page import describe_run
from robosim.rehearsal.readings import Readings, Steps, make_continuous, name_columns
from robosim.scene.grains import is_in_tool
from robosim.shapes import tool_shape


def make_turn(n: int) -> np.ndarray:
    """Quaternions (n, 4) of two turns about a fixed axis, as a converter of matrices gives them: with w >= 0."""
    angles = np.linspace(0.0, 4.0 * np.pi, n)
    axis = np.array([0.6, 0.0, 0.8])
    return Rotation.from_rotvec(angles[:, None] * axis).as_quat(canonical=True, scalar_first=True)


def test_signs_do_not_jump_and_rotations_stay() -> None:
    """Over two turns the quaternion returns to its start, over one to the opposite sign."""
    quaternions = make_turn(201)
    assert np.any(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0)
    continuous = make_continuous(-quaternions)
    assert np.all(np.sum(continuous[1:] * continuous[:-1], axis=1) > 0.9)
    assert np.array_equal(np.abs(continuous), np.abs(quaternions))
    assert continuous[0] == pytest.approx([1.0, 0.0, 0.0, 0.0])
    assert continuous[100] == pytest.approx([-1.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert continuous[200] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_the_file_has_one_sign_for_commanded_and_reached(tmp_path: Path) -> None:
    """Both come from different converters, so each row may have opposite signs for one rotation."""
    rng, quaternions = np.random.default_rng(0), make_turn(50)
    poses = [np.column_stack([np.full((50, 3), 0.1), rng.choice([-1, 1], (50, 1)) * quaternions]) for _ in range(2)]
    none = np.zeros((0, 7))
    steps = iter([Steps(np.arange(50) * 1e-3, *[np.zeros((50, 7))] * 7, *poses, *[np.zeros((50, 6))] * 6)])
    readings = Readings([f"A{k}" for k in range(1, 8)], (), lambda: next(steps, Steps(*[none] * 16)))
    readings.write_csv(tmp_path / "trajectory.csv")
    rows = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1)
    first = {name: name_columns(readings.joints).index(f"{name}_qw") for name in ("commanded", "reached")}
    commanded, reached = (rows[:, k : k + 4] for k in first.values())
    assert np.array_equal(commanded, reached)
    assert commanded == pytest.approx(make_continuous(quaternions), abs=1e-8)
    assert np.all(rows[:, first["reached"] - 3] == 0.1)


def test_grains_in_the_tool_are_not_delivered() -> None:
    """Grains above the area count after they left the bottle; those in front of a shovel's blade count at once."""
    for name, expected in (("bottle", (1.0 / 3.0, 1.0 / 3.0)), ("shovel", (2.0 / 3.0, 0.0))):
        config = load_rehearsal(name)
        middle = np.array(tool_shape(name).interior.centre)
        pose = mpm.Pose(np.array(config.area.centre) - middle, np.array([1.0, 0.0, 0.0, 0.0]))
        on_the_area = np.array(config.area.centre) + [0.0, 0.045, 0.0]
        run = SimpleNamespace(config=config, scooped=np.ones(3, bool),
                              is_held=lambda places, name=name, pose=pose: is_in_tool(name, places, pose),
                              solver=SimpleNamespace(masses=lambda: np.ones(3)))
        fractions = compute_fractions(run, np.array([config.area.centre, on_the_area, [0.0, 0.0, 0.0]]))
        assert (fractions["delivered_fraction"], fractions["retained_fraction"]) == pytest.approx(expected)
        assert fractions["spilled_fraction"] == pytest.approx(1.0 / 3.0)


def test_a_page_says_in_one_sentence_what_happened() -> None:
    bounds = get_bounds(load_rehearsal("spoon"))
    figures = dict.fromkeys(bounds, 0.0) | {
        "material": "sugar", "scooped_mass_kg": 0.0532109, "delivered_fraction": 0.998, "spilled_fraction": 0.0021,
        "wrist_payload_kg": 0.053, "path_error_inside_max_m": 0.00181234, "set_down_tilt_deg": None}
    said = describe_run(figures, [], bounds)
    assert said == "53.2 g of sugar scooped, 99.8 % delivered, 0.112 g spilled; every bound held; the closest: " \
                   "path error inside max, 1.81 mm of 2 mm"
    figures["spilled_fraction"] = 0.0712345678
    said = describe_run(figures, find_missed(dict(figures), load_rehearsal("spoon")), bounds)
    assert re.match(r"1 of \d\d bounds missed: spilled_fraction = 0.071235; accepted: 0 to 0.05. 53.2 g of", said)
