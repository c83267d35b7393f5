"""A replay buffer that joins demonstrations and the agent's own experience: all that makes an off-policy method
demonstration-guided (arXiv 2406.09178, Algorithm 3)."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer

import mpm

ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class DemoReplayBuffer(ReplayBuffer):
    """Two buffers behind the interface of one.

    Batches hold `demo_fraction` of demonstrations, and nothing else as long as there is nothing else. Without
    demonstrations they are those of an ordinary buffer, drawn with the same random numbers. What is added within
    `demonstrating()` is a demonstration. Observations may be arrays or, in a Dict space, dictionaries of arrays.
    Raises mpm.InvalidValue for a fraction outside 0 .. 1.
    """

    def __init__(self, buffer_size: int, observation_space: spaces.Space, action_space: spaces.Space, *args: Any,
                 demo_size: int = 50_000, demo_fraction: float = 0.5, **options: Any) -> None:
        if not 0.0 <= demo_fraction <= 1.0:
            raise mpm.InvalidValue(f"demo_fraction {demo_fraction}; accepted: 0 to 1")
        super().__init__(1, spaces.Box(0.0, 1.0, (1,), np.float32), action_space, *args, **options)  # holds nothing
        self.observation_space = observation_space
        kind: Any = DictReplayBuffer if isinstance(observation_space, spaces.Dict) else ReplayBuffer
        self.own = kind(buffer_size, observation_space, action_space, *args, **options)
        self.demo = kind(demo_size, observation_space, action_space, *args, **options)
        self.demo_fraction, self._into = demo_fraction, self.own

    @contextmanager
    def demonstrating(self) -> Iterator[None]:
        """What is added in here is a demonstration."""
        self._into = self.demo
        try:
            yield
        finally:
            self._into = self.own

    def add(self, *transition: Any) -> None:
        """Keep a transition: observation, next observation, action, reward, done, infos."""
        self._into.add(*transition)

    def size(self) -> int:
        """Transitions in both."""
        return self.own.size() + self.demo.size()

    def reset(self) -> None:
        """Forget both."""
        self.own.reset()
        self.demo.reset()

    def sample(self, batch_size: int, env: Any = None) -> Any:
        """A batch, demonstrations last; raises mpm.InvalidValue where neither buffer holds anything."""
        if not self.size():
            raise mpm.InvalidValue("sample: the buffer is empty; accepted: one with a transition or more")
        if not self.own.size():
            return self.demo.sample(batch_size, env)
        shown = round(batch_size * self.demo_fraction) if self.demo.size() else 0
        if shown in (0, batch_size):
            return (self.demo if shown else self.own).sample(batch_size, env)
        return joined(self.own.sample(batch_size - shown, env), self.demo.sample(shown, env))

    def __setattr__(self, name: str, value: object) -> None:
        """A device that is set after loading is set for both."""
        super().__setattr__(name, value)
        if name == "device":
            for part in ("own", "demo"):
                if part in self.__dict__:
                    setattr(self.__dict__[part], name, value)

    def __getstate__(self) -> dict[str, Any]:
        """Without the rows that hold nothing: the arrays are as long as what was allocated."""
        return {**self.__dict__, "own": trimmed(self.own), "demo": trimmed(self.demo), "_into": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.own, self.demo = untrimmed(*state["own"]), untrimmed(*state["demo"])
        self._into = self.own


def joined(own: Any, demo: Any) -> Any:
    """One batch from two; parts may be tensors, dictionaries of tensors, or None."""
    def join(a: Any, b: Any) -> Any:
        if a is None or b is None:
            return None
        return {key: torch.cat((a[key], b[key])) for key in a} if isinstance(a, dict) else torch.cat((a, b))

    return type(own)(*(join(a, b) for a, b in zip(own, demo)))


def trimmed(buffer: ReplayBuffer) -> tuple[type, dict[str, Any], int]:
    """Class, attributes with the arrays cut to the rows in use, and how many rows there were."""
    rows = buffer.size()
    state = dict(buffer.__dict__)
    for name in ARRAYS:
        value = state.get(name)
        if isinstance(value, dict):
            state[name] = {key: array[:rows] for key, array in value.items()}
        elif value is not None:
            state[name] = value[:rows]
    return type(buffer), state, buffer.buffer_size


def untrimmed(kind: Any, state: dict[str, Any], rows: int) -> Any:
    """The buffer again, with room for as many rows as it had."""
    def grown(array: np.ndarray) -> np.ndarray:
        whole = np.zeros((rows, *array.shape[1:]), array.dtype)
        whole[: len(array)] = array
        return whole

    for name in ARRAYS:
        value = state.get(name)
        if isinstance(value, dict):
            state[name] = {key: grown(array) for key, array in value.items()}
        elif value is not None:
            state[name] = grown(value)
    buffer = kind.__new__(kind)
    vars(buffer).update(state)
    return buffer
