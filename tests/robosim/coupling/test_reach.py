"""Bodies out of reach of all grains: neither probed nor brought, and nothing else is changed by that."""

import mujoco
import numpy as np
import pytest

import mpm
from robosim.coupling.mobility_probe import MobilityProbe
from robosim.coupling.plugin import GranularPlugin
from robosim.coupling.reach import Reach

CELL = 0.01
SAND = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)
BED = mpm.sample_box((0.0, 0.0, 0.0), (0.12, 0.12, 0.04), CELL / 2)
SCENE = """
<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
  <body name="ball" pos="0.06 0.06 0.19"><freejoint/><geom type="sphere" size="0.015" density="2000" friction="0.4"/>
  </body></worldbody></mujoco>
"""


def drop(coupling: str, steps: int, sleep: bool = False, speed: float = 0.0) -> tuple[GranularPlugin, list, np.ndarray]:
    """Let a ball fall from 13 cm above a bed; return the plugin, what `is_apart` said in each step, and heights."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[2] = speed
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.12, 0.12, 0.24), CELL), precision="f64", sleep=sleep,
                        walls=mpm.Walls(friction=0.5), bodies=[mpm.Body(SAND, BED, volume=1.25e-7)])
    plugin = GranularPlugin(model, data, solver, bodies={"ball": None}, coupling=coupling)
    answers, heights = [], []
    ask = plugin._reach.is_apart

    def note() -> bool:
        answers.append(ask())
        return answers[-1]

    plugin._reach.is_apart = note
    for _ in range(steps):
        plugin.step()
        heights.append(data.qpos[2])
    return plugin, answers, np.array(heights)


@pytest.mark.slow
@pytest.mark.parametrize("coupling", ["one_way", "mobility", "lagged"])
def test_a_ball_falls_and_lands_as_if_it_were_always_probed(coupling: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit, but where the motion of a fast ball that is far away would have made substeps shorter."""
    plugin, answers, heights = drop(coupling, 90)
    assert answers[0] and not answers[-1] and np.diff(answers).sum() == 1, "apart until it comes near, then together"
    monkeypatch.setattr(Reach, "is_apart", lambda reach: False)
    reference, _, expected = drop(coupling, 90)
    assert np.abs(heights - expected).max() <= (0.0 if coupling == "mobility" else 2e-6)
    assert plugin.solver.collider_impulse(0).force[2] != 0.0, "it has landed"
    if coupling == "mobility":
        state, other = plugin.solver.state(), reference.solver.state()
        assert all(np.array_equal(state[name], other[name]) for name in ("x", "v", "C", "e"))


@pytest.mark.long
def test_a_step_apart_probes_nothing_and_closes_its_ledger(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MobilityProbe, "predict", lambda *_: pytest.fail("probed"))
    plugin, answers, heights = drop("mobility", 40)
    assert all(answers) and plugin.repeats == 0 and not plugin.wrench("ball").force.any()
    assert not plugin.prediction_error.any()
    t = 0.002 * np.arange(1, 41)  # each step adds its velocity at the end: g dt^2 (1 + 2 + .. + n)
    assert np.allclose(heights, 0.19 - 9.81 * 0.5 * t * (t + 0.002), atol=1e-12)
    assert np.linalg.norm(plugin.ledger.residual.linear) < 1e-12 * plugin.ledger.exchanged[0]


@pytest.mark.long
def test_clearances_are_measured_rarely_and_a_rising_ball_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    clearance = mpm.Solver.clearance
    monkeypatch.setattr(mpm.Solver, "clearance", lambda *given: asked.append(1) or clearance(*given))
    _, answers, _ = drop("mobility", 60, speed=-1.5)
    assert not answers[-1] and len(asked) < 25
    plugin, answers, _ = drop("mobility", 3)
    plugin.data.qpos[2], plugin.data.qvel[2] = 0.07, 1.2
    plugin.restart()
    rising = []
    for _ in range(80):
        plugin.step()
        rising.append(bool(plugin._reach._is_apart))
    assert not rising[0] and any(rising[1:]), "in reach, then out of it"


@pytest.mark.slow
def test_states_hold_what_was_measured() -> None:
    plugin, _, _ = drop("mobility", 30, sleep=True)
    saved, grains = plugin.state(), plugin.solver.state()
    mujoco_state = plugin.data.qpos.copy(), plugin.data.qvel.copy()
    ends = []
    for _ in range(2):
        for _ in range(50):
            plugin.step()
        ends.append((plugin.data.qpos.copy(), plugin.solver.state()["v"], plugin._reach.state()))
        plugin.data.qpos[:], plugin.data.qvel[:] = mujoco_state
        plugin.solver.load(grains)
        plugin.load(saved)
    assert np.array_equal(ends[0][0], ends[1][0]) and np.array_equal(ends[0][1], ends[1][1])
    assert ends[0][2]["is_apart"] == ends[1][2]["is_apart"] and np.array_equal(ends[0][2]["gaps"], ends[1][2]["gaps"])
