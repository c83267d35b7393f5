"""A replay buffer that mixes demonstrations into batches: all that makes an off-policy method demonstration-guided.

Source: arXiv 2406.09178, Algorithm 3."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer

import mpm
from robosim.episode.play import Transition

ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Attributes of a buffer of Stable-Baselines3 with one row a transition."""


class DemoReplayBuffer(ReplayBuffer):
    """Two buffers, the agent's and the demonstrations', behind the interface of one.

    A fraction `demo_fraction` of each batch is demonstrations; the whole batch, while the agent has no transitions.
    Without demonstrations, batches are those of an ordinary buffer, drawn with the same random numbers. Transitions
    added within `demonstrating()` are demonstrations. Observations are arrays or, in a Dict space, dictionaries. Raises
    mpm.InvalidValue for a demo_fraction outside 0 to 1."""

    def __init__(self, buffer_size: int, observation_space: spaces.Space, action_space: spaces.Space, *args: Any,
                 demo_size: int = 50_000, demo_fraction: float = 0.5, n_envs: int = 1, **options: Any) -> None:
        if not 0.0 <= demo_fraction <= 1.0:
            raise mpm.InvalidValue(f"demo_fraction {demo_fraction}; accepted: 0 to 1")
        # The base class allocates for its own arrays, which are not used.
        super().__init__(1, spaces.Box(0.0, 1.0, (1,), np.float32), action_space, *args, **options)
        self.observation_space = observation_space
        kind: Any = DictReplayBuffer if isinstance(observation_space, spaces.Dict) else ReplayBuffer
        self.own = kind(buffer_size, observation_space, action_space, *args, n_envs=n_envs, **options)
        self.demo = kind(demo_size, observation_space, action_space, *args, **options)
        self.demo_fraction, self._target = demo_fraction, self.own

    @contextmanager
    def demonstrating(self) -> Iterator[None]:
        """Add transitions to the demonstrations within this context."""
        self._target = self.demo
        try:
            yield
        finally:
            self._target = self.own

    def add(self, *transitions: Any) -> None:
        """Add observations, next observations, actions, rewards, dones and infos, each with a leading index.
        It is the agent's environments, one transition of each; of demonstrations as many as there are."""
        if self._target is self.own:
            self.own.add(*transitions)
            return
        for k in range(len(transitions[-1])):
            self.demo.add(*(map_parts(lambda part: part[k : k + 1], part) for part in transitions))  # noqa: B023

    def size(self) -> int:
        """Return the number of transitions in both buffers."""
        return self.own.size() + self.demo.size()

    def reset(self) -> None:
        """Empty both buffers."""
        self.own.reset()
        self.demo.reset()

    def sample(self, batch_size: int, env: Any = None) -> Any:
        """Return a batch, demonstrations last. Raises mpm.InvalidValue where both buffers are empty."""
        if not self.size():
            raise mpm.InvalidValue("sample: the buffer is empty; accepted: one with a transition or more")
        if not self.own.size():
            return self.demo.sample(batch_size, env)
        n_demo = round(batch_size * self.demo_fraction) if self.demo.size() else 0
        if n_demo in (0, batch_size):
            return (self.demo if n_demo else self.own).sample(batch_size, env)
        return concatenate(self.own.sample(batch_size - n_demo, env), self.demo.sample(n_demo, env))

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute; `device`, which Stable-Baselines3 sets after loading, on both buffers too."""
        super().__setattr__(name, value)
        if name == "device":
            for part in ("own", "demo"):
                if part in self.__dict__:
                    setattr(self.__dict__[part], name, value)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without unused rows: the arrays are allocated at full capacity."""
        return {**self.__dict__, "own": trim(self.own), "demo": trim(self.demo), "_target": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.own, self.demo = restore(*state["own"]), restore(*state["demo"])
        self._target = self.own


def map_parts(function: Callable[..., Any], first: Any, *others: Any) -> Any:
    """Return a function of arrays, or of each part of dictionaries of arrays with the same keys."""
    if isinstance(first, dict):
        return {key: function(part, *(other[key] for other in others)) for key, part in first.items()}
    return function(first, *others)


def concatenate(own: Any, demo: Any) -> Any:
    """Return two batches as one; their fields are tensors, dictionaries of tensors, or None."""
    return type(own)(*(None if a is None or b is None else map_parts(lambda *both: torch.cat(both), a, b)
                       for a, b in zip(own, demo)))


def trim(buffer: ReplayBuffer) -> tuple[type, dict[str, Any], int]:
    """Return a buffer's class, its attributes with arrays cut to the rows in use, and its capacity."""
    rows = buffer.size()
    state = dict(buffer.__dict__)
    for name in ARRAYS:
        if state.get(name) is not None:
            state[name] = map_parts(lambda array: array[:rows], state[name])
    return type(buffer), state, buffer.buffer_size


def restore(kind: Any, state: dict[str, Any], capacity: int) -> Any:
    """Return the buffer that `trim` was given, at its full capacity."""
    def pad(array: np.ndarray) -> np.ndarray:
        padded = np.zeros((capacity, *array.shape[1:]), array.dtype)
        padded[: len(array)] = array
        return padded

    for name in ARRAYS:
        if state.get(name) is not None:
            state[name] = map_parts(pad, state[name])
    buffer = kind.__new__(kind)
    vars(buffer).update(state)
    return buffer


def prefill_demo_buffer(model: Any, transitions: Iterable[Transition], updates: int) -> int:
    """Add transitions to a model's demonstrations, with `updates` gradient updates after each; all at once for none.
    Returns the number of transitions. Source: arXiv 2406.09178, Algorithm 3, lines 2 to 11."""
    count = 0
    for part in ([step] for step in transitions) if updates else [list(transitions)]:
        with model.replay_buffer.demonstrating():
            model.replay_buffer.add(
                *(map_parts(lambda *rows: np.array(rows), *seen) for seen in (
                    [step.observation for step in part], [step.next_observation for step in part])),
                model.policy.scale_action(np.array([step.action for step in part])),
                np.array([step.reward for step in part], np.float32), np.array([step.done for step in part]),
                [step.info for step in part])
        if updates:
            model.train(updates, model.batch_size)
        count += len(part)
    return count
