"""Demonstrations: the way from actions to twists and back, descent, and the command."""

import gymnasium
import numpy as np
import pytest

from policies.demo import demonstrate, finished
from policies.descent import Descent
from policies.hold import Hold
from robosim.envs.task import load_task


def test_actions_become_twists_and_derivatives_return():
    """Against central differences, with a box that cuts some steps off."""
    hold = Hold(load_task("SpoonPour"), 10)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-0.6, 0.9, (hold.n, 6))
    linear, angular = hold.twists(actions)
    assert linear.shape == angular.shape == (1000, 3)
    places = hold._start + hold.dt * linear.cumsum(0)
    assert np.all(places <= hold._high + 1e-12)
    assert not hold._free.all()
    W, U = rng.standard_normal((1000, 3)), rng.standard_normal((1000, 3))
    bars = hold.back(W, U)
    for _ in range(20):
        way = rng.standard_normal(actions.shape)
        ends = []
        for s in (1e-7, -1e-7):
            v, w = hold.twists(actions + s * way)
            ends.append(np.sum(W * v) + np.sum(U * w))
        hold.twists(actions)
        assert np.sum(bars * way) == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-5, abs=1e-4)


def test_descent_goes_on_where_it_was():
    """On a valley whose sides differ by a factor of a hundred; a stored state gives the same steps to the bit."""
    scale = np.array([1.0, 100.0])

    def slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        return float(np.sum(scale * (x - 0.3) ** 2)), 2.0 * scale * (x - 0.3)

    one = Descent(np.zeros((4, 2)), 0.05)
    for _ in range(40):
        one.step(*slope(one.now))
    two = Descent(np.zeros((4, 2)), 0.05)
    two.load(one.state())
    for _ in range(60):
        one.step(*slope(one.now))
        two.step(*slope(two.now))
    assert np.array_equal(one.now, two.now)
    assert one.lowest == two.lowest < 1e-3
    assert np.abs(one.now).max() <= 1.0


def test_a_demonstration_is_made_kept_and_recognised(tmp_path):
    """Two iterations lower the loss; the derivative agrees with differences; files of another scene are refused."""
    assert demonstrate("SpoonTranslate", tmp_path, n=1, iterations=2, rate=0.05) == 0
    with np.load(tmp_path / "demonstration_0.npz", allow_pickle=False) as stored:
        found = dict(stored)
    assert found["actions"].shape == (100, 3)
    assert len(found["losses"]) == 2
    assert found["losses"][1] < found["losses"][0]
    derivative, difference = found["check"][0]
    assert derivative == pytest.approx(difference, rel=0.05)
    assert {p.name for p in tmp_path.iterdir()} == {"demonstration_0.npz", "demonstrations.json", "learning_curve.png"}
    with pytest.raises(ValueError, match="another scene"):
        finished(tmp_path / "demonstration_0.npz", "0" * 12)


def test_an_arm_has_no_roll_out():
    with pytest.raises(ValueError, match="mobile"):
        gymnasium.make("robosim/SpoonTranslate-v0", arm=True).unwrapped.rollout(10)
