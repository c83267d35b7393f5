"""Dosing: pour curves, balances, and controllers on a plant without grains."""

import copy
from pathlib import Path

import numpy as np
import pytest
import yaml
from pouring_plant import SALT, VIBRATION, Dose, Plant, shifted

from robosim.base.errors import ConfigError, UnknownName
from robosim.dosing import CONTROLLERS
from robosim.dosing.balance import Balance, FlowMeter
from robosim.dosing.command import accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import DosingNumbers, load_dosing
from robosim.dosing.pour_curve import PourCurve

NUMBERS = DosingNumbers.model_validate({
    "task": "Plant", "tool": "spoon", "curve": SALT, "vibration": VIBRATION,
    "pi": {"before_deg": 10, "search_deg": 4, "time": 2, "integral": 0.4, "first": 0.85, "pulse": 0.4}})
"""Chosen for the plant, whose pour curve spans more tilt than a spoon's."""
FLOUR = shifted(SALT, 12.0, 1.5)
EARLY = shifted(SALT, -10.0)


def pour(name: str, target: float, plant: Plant) -> Dose:
    """Pour a dose with a controller of NUMBERS, which knows the curve of salt."""
    return Dose(make_controller(name, NUMBERS, Plant.dt), plant, target)


@pytest.mark.parametrize("target", [1e-3, 20e-3, 60e-3])
@pytest.mark.parametrize("curve", [SALT, EARLY], ids=["known", "pours 10 deg earlier"])
def test_pi_doses_within_the_accepted_error(curve: PourCurve, target: float) -> None:
    for seed in range(3):
        dose = pour("pi", target, Plant(curve, seed))
        assert abs(dose.error) <= accepted_error(target), f"seed {seed}: {dose.error * 1e3:.2f} g"
        assert dose.commands[-1].done and dose.seconds < 20.0


def test_pi_finds_a_material_that_begins_later_and_leaves_in_slabs() -> None:
    """Slabs have 0.5 to 1.5 g, and it is not off by more than a usual one; the open loop pours nothing of it."""
    errors = [pour("pi", 20e-3, Plant(FLOUR, seed, slab=1e-3, slide=0.3)).error for seed in range(4)]
    assert np.abs(errors).max() <= 1e-3
    assert pour("open_loop", 20e-3, Plant(FLOUR, 0)).error < -15e-3


def test_pi_compensates_for_what_falls_after_a_stop() -> None:
    """With a balance that lags by half a second, most of what comes after the first stop is not yet seen there."""
    plant = Plant(SALT, 0)
    plant.lag = 0.5
    assert abs(pour("pi", 20e-3, plant).error) <= 1.1 * accepted_error(20e-3)


@pytest.mark.parametrize("target", [5e-3, 20e-3, 60e-3])
def test_open_loop_is_as_good_as_its_curve(target: float) -> None:
    assert abs(pour("open_loop", target, Plant(SALT, 1)).error) <= accepted_error(target)
    off = pour("open_loop", target, Plant(EARLY, 1)).error
    assert off == pytest.approx(EARLY.mass(SALT.tilt(target)) - target, abs=5e-4)


def test_shaker_reaches_targets_that_no_curve_gives() -> None:
    for target in (10e-3, 20e-3):
        dose = pour("shaker", target, Plant(FLOUR, 2, slab=1e-3))
        assert abs(dose.error) < 2e-3
        assert {c.amplitude for c in dose.commands} == {0.0, VIBRATION["amplitude"]}


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("target", [1e-3, 45e-3, 90e-3], ids=["1 g", "45 g", "more than the load"])
def test_every_dose_ends_level_in_time_with_bounded_commands(name: str, target: float) -> None:
    dose = pour(name, target, Plant(FLOUR, 3))
    assert dose.commands[-1].done and dose.seconds <= NUMBERS.motion.duration
    assert abs(np.degrees(dose.tilt)) < 2.0
    changes = np.diff(np.concatenate([[0.0], dose.rates]))
    assert np.abs(changes).max() <= np.radians(NUMBERS.motion.acceleration_deg) * Plant.dt * (1.0 + 1e-9)
    assert np.degrees(np.abs(dose.rates).max()) <= NUMBERS.motion.fast_deg * (1.0 + 1e-9)
    speeds = [np.linalg.norm(c.velocity) for c in dose.commands]
    assert max(speeds) <= NUMBERS.motion.approach_speed * (1.0 + 1e-9)
    assert max(c.amplitude for c in dose.commands) <= VIBRATION["amplitude"]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_tool_is_not_tilted_before_the_lip_is_above_the_cup(name: str) -> None:
    plant = Plant(SALT, 0)
    plant.lip = np.array([0.3, 0.0, 0.25])
    controller = make_controller(name, NUMBERS, Plant.dt)
    controller.start(5e-3, accepted_error(5e-3))
    while np.hypot(*plant.lip[:2]) > NUMBERS.motion.near:
        assert plant.tilt == 0.0
        plant.advance(controller.command(plant.sight(5e-3)))
    assert plant.time < 5.0


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_begins_a_second_dose_like_the_first(name: str) -> None:
    controller = make_controller(name, NUMBERS, Plant.dt)
    first, second = (Dose(controller, Plant(SALT, 4), 10e-3) for _ in range(2))
    np.testing.assert_array_equal(first.rates, second.rates)


@pytest.mark.parametrize("name", ["pi", "shaker"])
def test_a_dose_ends_as_soon_as_its_error_is_accepted(name: str) -> None:
    """It is the larger of two tolerances. A wide one takes less time, and one that nothing meets no eternity."""
    assert accepted_error(20e-3) == pytest.approx(0.4e-3) and accepted_error(5e-3) == pytest.approx(0.3e-3)
    assert accepted_error(20e-3, 5.0, 0.3) == pytest.approx(1e-3) and accepted_error(20e-3, 0.0, 0.0) == 0.0
    wide, narrow, none = (Dose(make_controller(name, NUMBERS, Plant.dt), Plant(SALT, 1), 20e-3, accepted)
                          for accepted in (4e-3, 0.3e-3, 0.0))
    assert abs(wide.error) <= 4e-3 and wide.seconds < narrow.seconds
    assert none.commands[-1].done and none.seconds <= NUMBERS.motion.duration


def test_what_cannot_be_made() -> None:
    with pytest.raises(UnknownName, match="controller 'pid'; valid: open_loop, pi, shaker"):
        make_controller("pid", NUMBERS, 0.02)
    with pytest.raises(ConfigError, match="control_dt = 20"):
        make_controller("pi", NUMBERS, 20)


@pytest.mark.parametrize(("name", "window", "control_dt"),
                         [("pi", 0.3, 0.11), ("pi", 0.05, 0.02), ("shaker", 0.3, 0.2)])
def test_a_window_with_too_few_readings_is_refused(name: str, window: float, control_dt: float) -> None:
    """With fewer than three readings the flow would be zero, whatever flows."""
    numbers = NUMBERS.model_copy(update={"pi": NUMBERS.pi.model_copy(update={"window": window})})
    with pytest.raises(ConfigError, match=rf"window.* = {window} s with control_dt = {control_dt} s.*accepted: .*at "
                                          rf"least 3 x control_dt = {3 * control_dt:g} s"):
        make_controller(name, numbers, control_dt)
    make_controller("open_loop", numbers, control_dt)


def test_a_balance_that_lags_shows_its_load_when_its_lag_is_known() -> None:
    """Behind a first-order filter a steady flow is shown by lag x flow too small."""
    meter, lag, flow, shown = FlowMeter(0.2, lag=0.3), 0.3, 4e-3, 0.0
    for k in range(200):
        shown += (flow * 0.02 * k - shown) * (1.0 - np.exp(-0.02 / lag))
        stream = meter.add(0.02 * k, shown)
    assert shown < flow * 0.02 * k - 0.9 * lag * flow
    assert stream.flow == pytest.approx(flow, rel=1e-3)
    assert stream.mass == pytest.approx(flow * 0.02 * k, abs=0.05 * lag * flow)


def test_the_flow_of_the_shortest_accepted_window() -> None:
    for control_dt in (0.02, 0.1):
        meter = FlowMeter(3 * control_dt)
        flows = [meter.add(k * control_dt, 2e-3 * k * control_dt).flow for k in range(10)]
        assert flows[:2] == [0.0, 0.0] and flows[2:] == pytest.approx([2e-3] * 8)


def test_the_filter_does_not_depend_on_the_interval_of_readings() -> None:
    """Of a mass that stays the same after a step: each reading is on the exponential."""
    balance, rng = Balance(0.2, 0.0, 0.0), np.random.default_rng(0)
    for interval in (0.01, 0.05, 0.37):
        memory = balance.start(1.0, 0.1)
        for time in 1.0 + interval * np.arange(1, 12):
            shown = balance.read(memory, time, 0.14, rng, tare=0.1)
            assert shown == pytest.approx(0.04 * (1.0 - np.exp(-(time - 1.0) / 0.2)), rel=1e-9)


def test_the_zero_drifts_along_a_line_with_a_slope_of_its_own() -> None:
    balance, slopes = Balance(0.0, 0.0, 0.0, drift=1e-5), []
    for seed in range(400):
        rng, memory = np.random.default_rng(seed), balance.start(0.0, 0.02)
        shown = np.array([balance.read(memory, time, 0.02, rng) - 0.02 for time in (1.0, 2.0, 5.0)])
        np.testing.assert_allclose(shown / [1.0, 2.0, 5.0], shown[0], rtol=1e-6)
        slopes.append(shown[0])
    assert np.std(slopes) == pytest.approx(1e-5, rel=0.1)
    assert abs(np.mean(slopes)) < 2e-6


def test_a_copied_memory_goes_on_with_the_same_bits() -> None:
    balance, rng = Balance(0.2, 1e-5, 1e-5, drift=1e-5), np.random.default_rng(3)
    memory = balance.start(0.0, 0.0)
    for k in range(1, 5):
        balance.read(memory, 0.02 * k, 0.01, rng)
    other, again = copy.deepcopy(memory), copy.deepcopy(rng)
    for k in range(5, 40):
        assert balance.read(memory, 0.02 * k, 0.02, rng) == balance.read(other, 0.02 * k, 0.02, again)


CURVE = SALT.model_dump(mode="json")


def test_tilt_is_the_inverse_of_mass() -> None:
    for mass in np.linspace(0.0005, 0.0799, 20):
        assert SALT.mass(SALT.tilt(mass)) == pytest.approx(mass)
    assert np.degrees(SALT.tilt(0.2)) == pytest.approx(75.0) and np.degrees(SALT.tilt(-1.0)) == pytest.approx(20.0)
    assert SALT.mass(SALT.begin) == pytest.approx(0.01 * SALT.load)


def test_a_mass_of_a_plateau_is_reached_at_its_begin() -> None:
    curve = PourCurve.model_validate(CURVE | {"masses": [0.0, 0.02, 0.02, 0.02, 0.05, 0.08]})
    assert np.degrees(curve.tilt(0.02)) == pytest.approx(30.0)
    assert np.degrees(curve.tilt(0.035)) == pytest.approx(55.0)


def test_tilt_per_mass_is_the_mean_slope_also_at_the_end() -> None:
    assert SALT.tilt_per_mass(0.02, 0.025) == pytest.approx(np.radians(10.0) / 0.025)
    at_end = np.radians(15.0) / 0.012
    assert SALT.tilt_per_mass(0.068, 0.012) == pytest.approx(at_end)
    assert SALT.tilt_per_mass(0.079, 0.012) == pytest.approx(at_end)
    assert SALT.tilt_per_mass(0.5, 0.012) == pytest.approx(at_end)


@pytest.mark.parametrize(("curve", "numbers", "message"), [
    ({"masses": [0.0, 0.002]}, {}, "6 tilts_deg and 2 masses; accepted: as many"),
    ({"tilts_deg": [20, 30, 30, 50, 60, 75]}, {}, "accepted: rising"),
    ({"masses": [0.0, 0.03, 0.02, 0.045, 0.068, 0.08]}, {}, "none below the one before"),
    ({"masses": [0.0, 0.002, 0.02, 0.045, 0.068, 0.09]}, {}, "90.00 g are poured of a load of 80.00 g"),
    ({"masses": [0.0] * 6}, {}, "0.00 g are poured in all; accepted: from 0.80 g"),
    ({"tilts_deg": [20, 30, 40, 50, 60, 400]}, {}, "less than or equal to 180"),
    ({"load": float("nan")}, {}, "load"),
    ({}, {"pi": {"fastest_deg": 90}}, "pi.fastest_deg = 90.0 with motion.fast_deg = 60.0"),
    ({}, {"pi": {"gain": 1}}, "unknown key 'pi.gain'; valid: before_deg"),
    ({}, {"shaker": {"amplitude": 2}}, "shaker.amplitude"),
])
def test_curves_and_numbers_that_are_refused(tmp_path: Path, curve: dict, numbers: dict, message: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"task": "Mine", "tool": "spoon", "curve": CURVE | curve, "vibration": VIBRATION,
                                    **numbers}))
    with pytest.raises(ConfigError, match=f"mine.yaml.*{message}"):
        load_dosing(str(path))
