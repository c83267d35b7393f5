"""Stand-ins for physics that takes long: a point that actions move, and a loss in closed form. Files are real."""

import os
from types import SimpleNamespace

import gymnasium
import numpy as np

DECISIONS = 20  # steps of an episode


class PointEnv(gymnasium.Env):
    """A point that actions move to a goal."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)

    def reset(self, *, seed=None, options=None):
        gymnasium.Env.reset(self, seed=seed)
        self.position, self.steps = self.np_random.uniform(-1.0, 1.0, 3), 0
        return self.position.astype(np.float32), {}

    def step(self, action):
        self.position, self.steps = self.position + 0.1 * np.asarray(action, float), self.steps + 1
        distance, info = float(np.abs(self.position - 0.5).sum()), {}
        if hasattr(self, "task"):
            info = {"tcs": -distance, "tcs_terms": {}, "is_success": False, "readings": dict.fromkeys(
                ("delivered", "spilled", "retained"), -distance)}
        return self.position.astype(np.float32), -distance, False, self.steps == DECISIONS, info


class PointTask(PointEnv):
    """The point as a sub-task of its own."""

    source = TASK = "SpoonTranslate"

    def __init__(self, **_):
        from robosim.config.materials import load_material
        from robosim.tasks.task import load_task

        self.task, self.material = load_task(self.source), load_material("salt")

    def objective(self):
        return None


class Valley:
    """A loss of a motion that is known in closed form; each evaluation is counted in a file."""

    def __init__(self, env, action_repeat, **_):
        self.rollout = SimpleNamespace(last=SimpleNamespace(norms=np.zeros((DECISIONS, 2))))

    def set_start(self):
        pass

    def value(self, actions):
        return self.value_and_grad(actions)[0]

    def value_and_grad(self, actions):
        with open(os.environ["EVALUATIONS"], "a") as file:
            file.write(".")
        scale = np.linspace(1.0, 30.0, actions.shape[1])
        return float(np.sum(scale * (actions - 0.3) ** 2)), 2.0 * scale * (actions - 0.3)

    def check_gradient(self, actions):
        return np.zeros((4, 2))
