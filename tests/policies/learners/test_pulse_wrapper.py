"""Pulses of a dose as decisions, on grains."""

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from policies.learners.learner import build_learner
from policies.learners.policy_file import export_policy
from policies.learners.pulses import HIDDEN, PulseWrapper
from policies.learning.environments import make_environment
from policies.learning.options import TrainingOptions
from policies.learning.presets import load_preset
from policies.methods.train import train
from robosim.dosing.command import accepted_error
from robosim.dosing.pulses import CHANGES, OBSERVED
from robosim.episode.play import play
from robosim.studies.policies.make import load_policy, make_policy, training_options
from robosim.studies.policies.network import Network
from robosim.studies.policies.tool_view import terms_of
from robosim.studies.tuning.trial import episode_cost
from robosim.tasks.task import load_task


class Pulses(gymnasium.Env):
    """An environment with spaces as of `PulseWrapper`, for models that are built only."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVED + HIDDEN,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (CHANGES,), np.float32)


def test_what_no_sensor_shows_is_for_the_critics_only(tmp_path: Any) -> None:
    """The actor's action does not change with it, the critics' values do; the policy's file takes what is seen."""
    model = build_learner(load_preset("pulses"), Pulses(), seed=0)
    torch.nn.init.normal_(model.actor.mu.weight)  # it begins as no correction
    seen = torch.randn(1, OBSERVED + HIDDEN)
    other = seen + torch.cat([torch.zeros(1, OBSERVED), torch.ones(1, HIDDEN)], 1)
    actions = [model.actor(one, deterministic=True) for one in (seen, other)]
    values = [model.critic(one, actions[0]) for one in (seen, other)]
    assert torch.equal(*actions)
    assert not torch.isclose(*values).any()
    assert export_policy(model.policy, tmp_path / "policy.npz")
    network = Network(tmp_path / "policy.npz", load_policy(tmp_path / "policy.npz"))
    network.check_sizes("pulses", (OBSERVED,), CHANGES)
    np.testing.assert_allclose(network(seen[0, :OBSERVED].numpy()), actions[0][0].detach(), atol=1e-6)


@pytest.mark.long
def test_decisions_that_change_nothing_are_pi_control_and_what_they_save_is_the_cost(tmp_path: Any) -> None:
    """Also from a policy's file, with an observation that is one array; and a change is not nothing."""
    env = make_environment("DoseSpoon", obs=list(terms_of(load_task("DoseSpoon"))), flatten=True, action_repeat=10)
    raw: Any = env.unwrapped
    wrapper, masses = PulseWrapper(env, 0.5, cost=0.25), {}

    def charge(info: dict[str, Any]) -> float:
        accepted = accepted_error(info["readings"]["target_mass"])
        return episode_cost({**info["readings"], "accepted_error": accepted, "diverged": ""}, 20.0)

    for change in (0.0, 1.0):
        _, info = wrapper.reset(seed=3)
        before, total, decisions, is_over = charge(info), 0.0, 0, False
        while not is_over:
            seen, reward, terminated, truncated, info = wrapper.step(np.full(2, change, np.float32))
            total, decisions, is_over = total + reward, decisions + 1, terminated or truncated
            assert np.isfinite(seen).all()
        assert 1 <= decisions < 60
        assert total == pytest.approx(before - charge(info) - 0.25 * change * decisions)
        masses[change] = info["readings"]["poured"], info["readings"]["seconds"]
    assert masses[0.0] != masses[1.0]
    weights, biases = np.zeros((CHANGES, OBSERVED), np.float32), np.zeros(CHANGES, np.float32)
    np.savez(tmp_path / "still.npz", weight_0=weights, bias_0=biases, activations=np.array(["none"]),
             bound=np.array("tanh"), residual=np.array(1.0), expert=np.array("pi"))
    for name in ("pi", str(tmp_path / "still.npz")):
        env.reset(seed=3)
        _, info = play(env, make_policy(name, raw, 0), observation=raw.observation)
        assert (info["readings"]["poured"], info["readings"]["seconds"]) == masses[0.0]


@pytest.mark.slow
def test_a_run_ends_with_a_policy_that_doses(tmp_path: Any) -> None:
    out = tmp_path / "run"
    assert train("pulses", "DoseSpoon", out, TrainingOptions(starts="random", action_repeat=10), episodes=2) == 0
    name = str(out / "best_policy.npz")
    env: Any = make_environment("DoseSpoon", **training_options(name)).unwrapped
    env.reset(seed=3)
    _, info = play(env, make_policy(name, env, 0), observation=env.observation)
    assert abs(info["readings"]["dose_error"]) < 0.2 * info["readings"]["target_mass"]
