"""Policies as files."""

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import SAC, TD3

from policies.learners.policy_file import export_policy
from robosim.studies.policies.network import Network


@pytest.mark.parametrize("kind", [SAC, TD3])
def test_a_policy_file_acts_as_the_policy(tmp_path, kind):
    """To single precision, with observations scaled before the network and in the file's first layer."""
    model = kind("MlpPolicy", gymnasium.make("Pendulum-v1"), seed=3, device="cpu", policy_kwargs={"net_arch": [32, 32]})
    rng = np.random.default_rng(0)
    offset, factor = rng.standard_normal(3), rng.uniform(0.5, 2.0, 3)
    assert export_policy(model.policy, tmp_path / "p.npz", (offset, factor))
    stored = dict(np.load(tmp_path / "p.npz"))
    for _ in range(20):
        observation = rng.standard_normal(3)
        x = observation
        for k, name in enumerate(stored["activations"]):
            x = Network.FUNCTIONS[str(name)](stored[f"weight_{k}"] @ x + stored[f"bias_{k}"])
        x = np.tanh(x) if stored["bound"] == "tanh" else np.clip(x, -1.0, 1.0)
        action, _ = model.predict(((observation - offset) * factor).astype(np.float32), deterministic=True)
        assert 2.0 * x == pytest.approx(action, abs=1e-4)  # the pendulum's torque is -2 to 2
