"""Dosing controllers on a plain model of a tool that pours: what they reach, and what they never do."""

import numpy as np
import pytest
from pouring_plant import SALT, VIBRATION, Dose, Plant, shifted

from robosim.base.errors import ConfigError, UnknownName
from robosim.dosing import CONTROLLERS
from robosim.dosing.balance import FlowMeter
from robosim.dosing.command import accepted_error
from robosim.dosing.controllers import make_controller
from robosim.dosing.numbers import DosingNumbers
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
