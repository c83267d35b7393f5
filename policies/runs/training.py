"""A run: the environment it learns in, its folder, and what happens at the end of every episode."""

import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv
from tqdm import tqdm

import mpm
from policies.demonstrations import reading as demonstrations
from policies.dynamics import rollouts as frames
from policies.learning.environments import any_made
from policies.learning.files import digest
from policies.learning.learner import Corrected, build, kind_of
from policies.learning.network import export
from policies.learning.observation_scaling import Scaled
from policies.learning.presets import Preset
from policies.runs import checkpoint
from policies.runs.episodes import Episode, Episodes
from policies.runs.run_folder import RunFolder, commit

EVERY = 10
"""Episodes between checkpoints, which go between two."""
LATEST = 30
"""Episodes after which a checkpoint is written within one."""


class Training:
    """One run in one folder, from where it stands; `learn` (or another method's function) brings it to its end.

    starts: "nominal", the task's own start in every episode as in the paper, or "random" within its ranges. demos: what
    `demonstrations.read` takes. roll_outs: folder of `robosim frames`. Raises mpm.InvalidValue for what does not fit.
    """

    def __init__(self, method: str, preset: Preset, task: str, out: Path, *, seed: int = 0, demos: Path | None = None,
                 starts: str = "nominal", hold: int = 10, force: bool = False, roll_outs: Path | None = None,
                 **options: Any) -> None:
        self.preset, self.seed, self.hold = preset, seed, hold
        self.base: Any = any_made(task, preset.obs, hold, **options)
        raw = self.base.unwrapped
        granular = hasattr(raw, "task")
        self.decisions = -(-raw.task.steps // hold) if granular else self.base.spec.max_episode_steps
        if self.decisions is None or not isinstance(self.base.action_space, gymnasium.spaces.Box):
            raise mpm.InvalidValue(f"task {task!r}: accepted: continuous actions and episodes of a fixed length")
        self.cap: float | None = raw.reward.extremes()[1] if granular else None
        self.nominal = {"nominal": True} if granular else None
        self.reset_options = self.nominal if starts == "nominal" else None
        task = getattr(raw, "TASK", "") or task  # as files name it, also where it was given as it is registered
        self.sequences, self.rollouts = self._sequences(demos, task if granular else ""), self._rollouts(roll_outs)
        self.task, self.source = task, getattr(raw, "source", "") or task
        self._begun = {path.name: demonstrations.start_in(path)
                       for path in (demonstrations.paths_in(demos) if self.sequences and demos is not None else ())}
        self._check_starts(starts)
        if granular and preset.scaled and preset.obs != "dict":
            self.base = Scaled(self.base, preset.obs)
        scene = [raw.task.model_dump(), raw.material.model_dump()] if granular else [task]
        self.folder = RunFolder(out, {
            "method": method, "preset": preset.model_dump(), "task": task, "seed": seed, "starts": starts, "hold": hold,
            "material": options.get("material") or (raw.task.material if granular else None),
            "fingerprint": digest(scene), "demonstrations": self._shown(),
            "commit": commit(), "command": " ".join(sys.argv)}, force)
        self.env = Episodes(self.base, seed, self.reset_options, self._ended)
        self.acting: gymnasium.Env = self.env
        if preset.residual is not None:
            self.acting = Corrected(self.env, next(iter(self.sequences.values())), preset.residual,
                                    preset.correction_cost)
        self.progress: tqdm = tqdm(total=preset.episodes, desc=f"{method} {task} seed {seed}", file=sys.stderr)
        self.model: Any = None
        self._improved = False

    def _sequences(self, demos: Path | None, task: str) -> dict[str, np.ndarray]:
        """Actions of the demonstrations, by file."""
        asked = self.preset.shown
        if demos is not None and not asked and "CMA-ES" not in self.preset.learner:  # which may begin with one
            raise mpm.InvalidValue(f"--demos {demos}: this method takes no demonstrations; leave it out")
        if demos is None and not asked:
            return {}
        if demos is None:
            raise mpm.InvalidValue("this method learns from demonstrations; give their folder as --demos")
        return demonstrations.read(demos, self.decisions, self.hold, self.base.action_space.shape[0], task)

    def _check_starts(self, starts: str) -> None:
        """Raise mpm.InvalidValue where a motion is to be played from another start than it was made for."""
        if self.preset.graph is not None and starts != "nominal":
            raise mpm.InvalidValue(f"--starts {starts}: this method plans one motion, from the task's own start; "
                                   f"accepted: nominal")
        count = len(self._begun) if self.preset.learner == "replay" else int(self.preset.residual is not None)
        played = list(self._begun)[:count]
        aside = [name for name in played if not self._begun[name][1]["nominal"]] if starts == "nominal" else []
        if aside and len(aside) == len(played):
            raise mpm.InvalidValue(f"--demos: {', '.join(aside)}: made for a start aside of the task's own, from which "
                                   f"this method plays; accepted: the first of `robosim demo --nominal`")
        if self.preset.learner == "replay":
            self.sequences = {name: actions for name, actions in self.sequences.items() if name not in aside}

    def _rollouts(self, folder: Path | None) -> frames.Rollouts | None:
        """The roll-outs of a folder, where the method takes some."""
        needed = self.preset.graph is not None
        if needed != (folder is not None):
            raise mpm.InvalidValue("this method learns from roll-outs; give their folder as --frames" if needed else
                                   f"--frames {folder}: this method takes no roll-outs; leave it out")
        return None if folder is None else frames.read(folder, self.base.unwrapped)

    def _shown(self) -> dict[str, str]:
        """What the run learns from, by file, as digests."""
        told = {name: digest(actions.tolist()) for name, actions in self.sequences.items()}
        if self.rollouts is not None:
            told["frames"] = digest([places.tobytes().hex() for places in self.rollouts.grains])
        return told

    def _ended(self, episode: Episode) -> None:
        self._improved |= self.folder.add(episode, self.hold)
        told = {key: f"{episode.row[key]:.2f}" for key in ("return", "tcs") if key in episode.row}
        self.progress.set_postfix(told)
        self.progress.update()
        self.folder.status("running")

    @property
    def over(self) -> bool:
        """Whether all episodes are done, or there is nothing left to reach."""
        return self.env.count >= self.preset.episodes or self.folder.capped(self.cap)

    def start_again(self, state: dict[str, Any]) -> None:
        """Go on from the rest of a checkpoint: episodes and random numbers."""
        self.folder.rows, self.folder.best, self.env.count = state["rows"], state["best"], len(state["rows"])
        self.progress.update(self.env.count)
        checkpoint.resume(state, self.model)

    def keep(self, **more: Any) -> None:
        """Write a checkpoint."""
        checkpoint.save(self.folder.checkpoint, self.model, rows=self.folder.rows, best=self.folder.best, **more)

    def keep_best(self, policy: Any) -> None:
        """Keep the policy if the episode that has just ended was the best so far."""
        if self._improved and self.preset.residual is None:  # a correction is no policy without what it corrects
            units = (self.base.offset, self.base.factor) if isinstance(self.base, Scaled) else None
            export(policy, self.folder.path / "best_policy.npz", units, obs=self.preset.obs, hold=self.hold,
                   task=self.folder.manifest["task"], method=self.folder.manifest["method"])
        self._improved = False

    def demonstrated(self) -> Any:
        """Transitions of all demonstrations, acted out where is learnt, each from its own start."""
        for name, actions in self.sequences.items():
            seed, options = self._begun[name]
            yield from demonstrations.acted(self.base, actions, options if self.nominal else None, seed)

    def learn(self, venv: Any = None, part: Any = None) -> None:
        """Run a method of stable_baselines3 to its end; part: another callback, with its own `state` and `load`."""
        venv = venv or DummyVecEnv([lambda: self.acting])
        logger = configure(str(self.folder.path), ["tensorboard"])
        if self.folder.checkpoint.is_file():
            self.model, state = checkpoint.load(self.folder.checkpoint, kind_of(self.preset), venv)
            self.model.set_logger(logger)
            if part is not None:
                part.load(state["part"])
            self.start_again(state)
            self.model._last_obs = venv.reset()
        else:
            self.model = build(self.preset, venv, self.seed, getattr(self.base.unwrapped, "observation_slices", None))
            self.model.set_logger(logger)
            wanted = self.preset.demonstrations
            if wanted is not None:
                demonstrations.guide(self.model, self.demonstrated(), wanted.updates)
        first = self.env.count == 0
        keeper = Keeper(self, part)
        while not self.over:
            left = (self.preset.episodes - self.env.count) * self.decisions
            self.model.learn(left, callback=[keeper, *([part] if part else [])], reset_num_timesteps=first)
            first = False

    def replay_best(self) -> dict[str, Any]:
        """The best actions once more, from the start that they were found at; nothing where there are none."""
        path = self.folder.path / "best.npz"
        if not path.is_file():
            return {}
        with np.load(path, allow_pickle=False) as stored:
            actions, start = stored["actions"], int(stored["start"])
        total, info = 0.0, {}
        for step in demonstrations.acted(self.base, actions, self.reset_options, start):
            total, info = total + step.reward, step.info
        return {"return": total, **({"tcs": info["tcs"], "is_success": info["is_success"], **info["readings"]}
                                    if "tcs" in info else {})}

    def finish(self) -> None:
        """Close the run: its best replayed, its status written."""
        self.progress.close()
        reason = "score stayed at its highest" if self.folder.capped(self.cap) else "every episode done"
        self.folder.status("finished", reason=reason, replayed=self.replay_best(), highest=self.cap)


class Keeper(BaseCallback):
    """Keeps the best policy at the end of an episode, a checkpoint between two, and stops where nothing is left."""

    def __init__(self, training: Training, part: Any) -> None:
        super().__init__()
        self.training, self._part, self._kept = training, part, training.env.count

    def _on_rollout_start(self) -> None:
        count = self.training.env.count
        # PPO's batches may end within episodes for good, once one has ended early: then the next begins anew
        if count >= self._kept + EVERY and (not self.training.env.under_way or count >= self._kept + LATEST):
            self.training.keep(part=self._part.state() if self._part else None)
            self._kept = count

    def _on_step(self) -> bool:
        self.training.keep_best(self.model.policy)
        return not self.training.over
