"""A training run: its environment, its folder, and what is stored at the end of every episode."""

import math
import shutil
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv

import mpm
from mpm.array_files import read_arrays
from mpm.files import write
from policies.demonstrations.reading import load_demonstrations, select_replayable
from policies.dynamics.rollouts import Rollouts, read_rollouts
from policies.learners.buffers import prefill_demo_buffer
from policies.learners.learner import build_learner, learner_class
from policies.learners.policy_file import export_policy
from policies.learners.pulses import PulseWrapper
from policies.learners.wrappers import ResidualActionWrapper, ScaledObservation
from policies.learning.environments import field_digest, fingerprint, make_training_environment, task_digest
from policies.learning.options import TrainingOptions
from policies.learning.presets import OFF_POLICY, Preset
from policies.runs import checkpoint
from policies.runs.checkpoint import Checkpoints
from policies.runs.episode_batch import EpisodeBatch
from policies.runs.episodes import Episode, Episodes
from policies.runs.evaluations import Evaluations
from policies.runs.event_log import EventLog
from policies.runs.run_folder import RunFolder
from robosim.base.digests import digest, exercised_code
from robosim.base.files import describe_end, end_state
from robosim.base.progress import Progress
from robosim.base.provenance import commit
from robosim.episode.play import Transition, play, read_scores, run_episode
from robosim.senses.perception import observation_options
from robosim.studies.policies import PULSED
from robosim.tasks.task import load_task

CHECKPOINT_LATEST = 30
"""Episodes after which a checkpoint is made within an episode."""

MAX_BUFFER = 16 * 2**30
"""Bytes of the transitions that a run collects: what a workstation has."""


class Training:
    """One run in one folder. A method (`policies.methods.method.Method`) brings it to its end.
    Raises mpm.InvalidValue for arguments that do not fit each other, or a folder that holds another run."""

    def __init__(self, method: str, preset: Preset, task: str, out: Path, options: TrainingOptions) -> None:
        self.preset, self.options = preset, options
        self.seed, self.action_repeat, self.n_envs = options.seed, options.action_repeat, options.n_envs
        scene = {key: getattr(options, key) for key in ("material", "randomize") if getattr(options, key)}
        starts: str = {None: options.starts, "nominal": "random"}.get(options.randomize, options.randomize or "")
        self.base: Any = make_training_environment(task, preset.obs, self.action_repeat, **scene)
        """The environment, with scaled observations where the preset asks for them."""
        raw = self.base.unwrapped
        self.is_granular = hasattr(raw, "task")
        self.decisions = -(-raw.task.steps // self.action_repeat) if self.is_granular else \
            self.base.spec.max_episode_steps
        """Decisions of an episode."""
        if self.decisions is None or not isinstance(self.base.action_space, gymnasium.spaces.Box):
            raise mpm.InvalidValue(f"task {task!r}: accepted: continuous actions and episodes of a fixed length")
        self.dimensions: int = self.base.action_space.shape[0]
        """Of an action."""
        self.task = getattr(raw, "TASK", "") or task  # as files name it, also where it was given as it is registered
        self.source = getattr(raw, "source", "") or self.task
        if self.n_envs > 1:
            self._check_batch()
        self.demonstrations = load_demonstrations(preset, options.demos, self.decisions, self.action_repeat,
                                                  self.dimensions, self.task if self.is_granular else "")
        self.rollouts = self._load_rollouts(options.rollouts)
        if preset.needs_rollouts and starts != "nominal":
            raise mpm.InvalidValue(f"{starts} starts: this method plans one motion, from the task's own "
                                   f"start; accepted: nominal")
        self.demonstrations = select_replayable(self.demonstrations, preset, starts)
        if self.is_granular and preset.scaled and preset.obs != "dict":
            self.base = ScaledObservation(self.base, preset.obs, preset.grains_as_one)
        self.reset_options = {"nominal": True} if self.is_granular and starts == "nominal" else None
        digests = {one.name: digest(one.actions.tolist()) for one in self.demonstrations}  # of what it learns from
        if self.rollouts is not None:
            digests["rollouts"] = digest([grains.tobytes().hex() for grains in self.rollouts.grains])
        self.folder = RunFolder(out, {
            "method": method, "label": options.label, "preset": preset.model_dump(), "task": self.task,
            "seed": self.seed, "starts": starts, "action_repeat": self.action_repeat, "n_envs": self.n_envs,
            "material": options.material or (raw.task.material if self.is_granular else None),
            "fingerprint": fingerprint(raw, *([raw.world.randomization.describe()] if options.randomize else [])) if
            self.is_granular else digest([self.task]),
            "task_digest": task_digest(raw) if self.is_granular else None,
            "field": field_digest(raw) if self.is_granular else None, "code": exercised_code(),
            "demonstrations": digests, "commit": commit(), "command": " ".join(sys.argv)}, options.force)
        self.checkpoints = Checkpoints(self.folder.checkpoint, options.checkpoint_every)
        self.env: Any = Episodes(self.base, self.seed, self.reset_options, self._on_episode_end)
        """What reports the run's episodes."""
        if self.n_envs > 1:
            self.env = EpisodeBatch(task, self.n_envs, self.base, self.seed, self.reset_options, self._on_episode_end,
                                    preset.episodes, action_repeat=self.action_repeat,
                                    **observation_options(preset.obs), **scene)
        self.agent_env: Any = self.env
        """The environment that a learner acts in: `env`, or corrections of a motion or an expert in it."""
        evaluated = self.base
        if preset.residual is not None:
            if preset.expert is not None and not self.is_granular:
                raise mpm.InvalidValue(f"expert {preset.expert} with task {self.task}; accepted: with a sub-task")
            motion = None if preset.expert is not None else self.demonstrations[0].actions
            wrap: Any = PulseWrapper if preset.expert == PULSED else partial(ResidualActionWrapper, base=motion)
            self.agent_env = wrap(self.env, share=preset.residual, cost=preset.correction_cost)
            evaluated = wrap(self.base, share=preset.residual)
        self.progress = Progress(total=preset.episodes, desc=f"{method} {self.task} seed {self.seed}", unit="episodes")
        self.model: Any = None
        self.evaluations: Evaluations | None = None
        if self.is_granular:
            self.evaluations = Evaluations(evaluated, out, options.evaluate_every, self.reset_options, self.n_envs == 1)

    @property
    def is_over(self) -> bool:
        """Whether all episodes are done."""
        return self.env.count >= self.preset.episodes

    def _check_batch(self) -> None:
        """Refuse several environments where the method or the task cannot have them."""
        preset, n = self.preset, self.n_envs
        if not self.is_granular:
            raise mpm.InvalidValue(f"--n-envs {n} with task {self.task}; accepted: 1, or a sub-task with grains")
        if preset.learner not in (*OFF_POLICY, "PPO") or preset.residual is not None:
            raise mpm.InvalidValue(f"--n-envs {n} with learner {preset.learner} and residual {preset.residual}; "
                                   f"accepted: 1, or {', '.join((*OFF_POLICY, 'PPO'))} without residual")

    def _check_buffer(self) -> None:
        """Refuse a replay buffer that would fill more memory in this run's episodes than a computer has."""
        space = self.agent_env.observation_space
        parts = list(space.values()) if isinstance(space, gymnasium.spaces.Dict) else [space]
        size = sum(4 * math.prod(part.shape or ()) for part in parts)
        count = min(self.preset.options.get("buffer_size", 0), self.preset.episodes * self.decisions)
        demonstrated = len(self.demonstrations) * self.decisions
        count += min(self.preset.demonstrations.size if self.preset.demonstrations else 0, demonstrated)
        if 2 * size * count > MAX_BUFFER:
            raise mpm.InvalidValue(f"buffer of {count} transitions with two observations of {size} bytes: "
                                   f"{2 * size * count:.3g} bytes; accepted: up to {MAX_BUFFER}; lower "
                                   f"options.buffer_size or episodes, or observe fewer grains")

    def _load_rollouts(self, folder: Path | None) -> Rollouts | None:
        if self.preset.needs_rollouts != (folder is not None):
            raise mpm.InvalidValue("this method learns from rollouts; give their folder as --rollouts"
                                   if self.preset.needs_rollouts else
                                   f"--rollouts {folder}: this method takes no rollouts; leave it out")
        return None if folder is None else read_rollouts(folder, self.base.unwrapped)

    def _on_episode_end(self, episode: Episode) -> None:
        self.folder.add(episode, self.action_repeat)
        self.progress.set_postfix({key: f"{episode.row[key]:.2f}" for key in ("return", "tcs") if key in episode.row})
        self.progress.update()
        self.folder.write_status("running", **self.evaluated)

    @property
    def evaluated(self) -> dict[str, Any]:
        """Last and best evaluation of the deterministic policy, and the seconds of all of them."""
        if self.evaluations is None:
            return {"evaluated": {}}
        return {"evaluated": self.evaluations.summary,
                "evaluating_s": sum(row["seconds"] for row in self.evaluations.rows)}

    def resume(self, state: dict[str, Any]) -> None:
        """Restore episodes and random numbers from the parts of a checkpoint."""
        self.folder.rows, self.folder.best_return = state["rows"], state["best"]
        self.env.count = self.checkpoints.stored = len(state["rows"])
        if self.evaluations:
            self.evaluations.rows = state.get("evaluations", [])
            self.evaluations.write_rows()
        self.progress.update(self.env.count)
        self.folder.write_episodes()  # a run that was killed has written more of them
        self.folder.write_status("running")
        checkpoint.restore_random_state(state, self.model)

    def load_checkpoint(self, kind: Any = None, env: Any = None) -> dict[str, Any]:
        """Return the parts of the checkpoint, {} without one; its model is set. Raises as `checkpoint.load`."""
        if not self.folder.checkpoint.is_file():
            return {}
        self.model, parts = checkpoint.load(self.folder.checkpoint, kind, env, self.options.trust)
        return parts

    def save_checkpoint(self, **parts: Any) -> None:
        """Write a checkpoint of the model, the episodes and a method's own parts."""
        self.keep_checkpoint(at_once=True, **parts)

    def keep_checkpoint(self, at_once: bool = False, **parts: Any) -> None:
        """Make a checkpoint, to be written at once, or when it is due or when the run is interrupted."""
        if self.n_envs > 1:
            parts["batch"] = self.env.state()
        self.checkpoints.keep(self.env.count, checkpoint.pack(
            self.model, rows=self.folder.rows, best=self.folder.best_return,
            evaluations=self.evaluations.rows if self.evaluations else [], **parts), at_once)

    def stop(self, error: BaseException) -> str:
        """Write the last checkpoint and the status after what ended the run; return what the same command will do.
        What a full disk does not take is reported on stderr."""
        self.progress.close()
        is_resumed = self.env.count > 0 or not self.folder.checkpoint.is_file()
        write_status = self.folder.write_status if is_resumed else self.folder.update_status
        for store in (self.checkpoints.write, lambda: write_status(
                end_state(error), reason=f"{describe_end(error)}; {self.checkpoints.describe()}")):
            try:
                store()
            except OSError as failure:
                print(f"{self.folder.path}: {failure}", file=sys.stderr)
        return self.checkpoints.describe()

    def evaluate(self, policy: Any) -> None:
        """Evaluate the policy where that is due; write it to last_policy.npz, and the best to best_policy.npz.
        Raises SaturatedActor."""
        if self.evaluations is None or not self.evaluations.is_due(self.env.count, self.is_over):
            return
        is_best, last = self.evaluations.add(policy, self.env.count), self.folder.path / "last_policy.npz"
        share, expert = self.preset.residual, self.preset.expert
        if share is not None and expert is None:
            return  # a correction is no policy without its motion
        residual = {} if share is None else {"residual": share, "expert": expert}
        units = (self.base.offset, self.base.factor) if isinstance(self.base, ScaledObservation) else None
        table = load_task(self.source).model_dump_json(exclude={"description"})  # "hard" changes the environment's own
        if export_policy(policy, last, units, obs=self.preset.obs, action_repeat=self.action_repeat, task=self.task,
                         method=self.folder.manifest["method"], task_table=table, **residual) and is_best:
            write(last.with_name("best_policy.npz"), lambda path: shutil.copyfile(last, path))

    def demonstration_transitions(self) -> Iterator[Transition]:
        """Yield the transitions of all demonstrations, played in the run's environment, each from its own start."""
        for _, actions, seed, options in self.demonstrations:
            yield from run_episode(self.base, actions, seed=seed, options=options if self.is_granular else None)

    def learn(self, venv: Any = None, callback: Any = None) -> None:
        """Run a learner of Stable-Baselines3 to the run's end; the method of most presets.
        venv: the vectorized environment, by default of `agent_env` alone. callback: one of Stable-Baselines3 whose
        `state()` is part of checkpoints, from which `load` restores it."""
        if venv is None:
            venv = self.env if self.n_envs > 1 else DummyVecEnv([lambda: self.agent_env])
        if state := self.load_checkpoint(learner_class(self.preset), venv):
            self.model.set_logger(EventLog.resume(self.folder.event_log, state["log"]))
            if callback is not None:
                callback.load(state["callback"])
            self.resume(state)
            if self.n_envs > 1:
                self.env.load(state["batch"])
            else:
                self.model._last_obs = venv.reset()
        else:
            self._check_buffer()
            self.model = build_learner(self.preset, venv, self.seed,
                                       getattr(self.base.unwrapped, "observation_slices", None))
            if self.preset.actor and self.folder.manifest["starts"] != "nominal":  # whose returns do not compare
                self.model.imitation = 0.0
            self.model.set_logger(Logger(str(self.folder.path), [EventLog(self.folder.event_log, 0)]))
            if self.preset.demonstrations is not None:
                prefill_demo_buffer(self.model, self.demonstration_transitions(), self.preset.demonstrations.updates)
        is_first = self.env.count == 0
        checkpoints = CheckpointCallback(self, callback)
        while not self.is_over:
            steps_left = (self.preset.episodes - self.env.count) * self.decisions
            self.model.learn(steps_left, callback=[checkpoints, *([callback] if callback else [])],
                             reset_num_timesteps=is_first)
            is_first = False

    def finish(self) -> None:
        """Replay the best actions, if there are any, from their own start, and write the final status."""
        self.progress.close()
        path, replayed = self.folder.path / "best.npz", {}
        if path.is_file():
            stored = read_arrays(path)
            total, info = play(self.base, stored["actions"], seed=int(stored["start"]), options=self.reset_options)
            replayed = {"return": total, **read_scores(info)}
        self.folder.write_status("finished", reason="every episode done", replayed=replayed, **self.evaluated)


class CheckpointCallback(BaseCallback):
    """Evaluates the policy and checkpoints between episodes; stops when the run is over."""

    def __init__(self, training: Training, callback: Any) -> None:
        super().__init__()
        self.training, self._callback, self._kept_at = training, callback, training.env.count
        self._acted: float | None = None

    def _on_rollout_end(self) -> None:
        self._acted = time.perf_counter()

    def _on_rollout_start(self) -> None:
        if self._acted is not None:  # what lies between two rollouts is updates
            self.training.env.updating += time.perf_counter() - self._acted
        count = self.training.env.count
        # Once an episode has ended early, PPO's batches may never again end between episodes: then the checkpoint is
        # made within an episode, which a resumed run starts again.
        is_late = count >= self._kept_at + CHECKPOINT_LATEST
        if count > self._kept_at and (self.training.env.is_resumable or is_late):
            log: Any = self.logger.output_formats[0]
            self.training.keep_checkpoint(callback=self._callback.state() if self._callback else None,
                                          log=log.state(self.logger))
            self._kept_at = count

    def _on_step(self) -> bool:
        self.training.evaluate(self.model.policy)
        return not self.training.is_over
