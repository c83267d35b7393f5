"""`robosim bench learner`: decisions and updates a second of a learner, apart and together."""

from functools import partial

import torch

from policies.learners.learner import build_learner
from policies.learners.wrappers import ScaledObservation
from policies.learning.environments import make_training_environment
from policies.learning.options import TrainingOptions
from policies.learning.presets import load_preset
from robosim.studies.benchmarks.bench import median_seconds

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "BottlePickPour", "ShovelMove", "DoseSpoon")


def measure_learner(tasks: tuple[str, ...] = TASKS, n: int = 50) -> dict[str, float]:
    """Time n decisions without updates, their updates by dg_sac, and both; with one thread, as in a run."""
    torch.set_num_threads(1)
    figures, preset = dict[str, float](), load_preset("dg_sac")
    for task in tasks:
        env = make_training_environment(task, preset.obs, TrainingOptions().action_repeat)
        model = build_learner(preset, ScaledObservation(env, preset.obs), 0)
        act, update = partial(model.learn, n, reset_num_timesteps=False), partial(model.train, n, model.batch_size)
        figures[f"{task}: decisions per second with updates"] = n / median_seconds(act, 3)
        figures[f"{task}: updates per second"] = n / median_seconds(update, 3)
        model.gradient_steps = 0
        figures[f"{task}: decisions per second without updates"] = n / median_seconds(act, 3)
    return figures
