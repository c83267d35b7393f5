"""The network of a sub-task: how it learns from roll-outs, and what it foresees of a motion."""

import copy
import sys
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from mpm.geometry.rigid_motion import Pose
from mpm.rollout.tool_twists import path
from policies.demonstrations.action_repeat import Hold
from policies.dynamics.graph_network import GraphNetwork, arrays, beside, filled, graph_of, scales_of
from policies.dynamics.rollouts import Rollouts, Solid
from policies.learning.presets import GraphSizes

HELD_BACK = 10
"""One roll-out in so many is kept for the test."""
EVERY = 250
"""Updates between two checkpoints."""
CLIP = 1.0
"""Largest norm of a gradient."""
FAR = 10.0
"""Coordinate [m] that no grain of a table-top has."""
TESTED = 5
"""One frame in so many of a test's roll-out is foreseen by itself."""


class GraphModel:
    """A network, its units, and the rigid parts of its scene."""

    def __init__(self, sizes: GraphSizes, rollouts: Rollouts, solids: list[Solid], floor: float, seed: int) -> None:
        torch.manual_seed(seed)
        self._learnt = [k for k in range(len(rollouts.grains)) if k % HELD_BACK]
        self.test = [k for k in range(len(rollouts.grains)) if k % HELD_BACK == 0]
        self.sizes, self.scales, self.floor = sizes, scales_of([rollouts.grains[k] for k in self._learnt]), floor
        self.network = GraphNetwork(sizes)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=sizes.learning_rate)
        self.tool = next(solid.points for solid in solids if solid.moves)
        self.standing = np.concatenate([np.zeros((0, 3)), *(s.points for s in solids if not s.moves)])
        self.updates = 0
        self.losses: deque[float] = deque(maxlen=100)
        """Of the last updates."""
        self._rng = np.random.default_rng(seed)
        self._places = [self._rested(places.astype(float)) for places in rollouts.grains]
        self._tools = [self._rested(np.stack([Pose(row[:3], row[3:]).apply(self.tool) for row in rows]))
                       for rows in rollouts.poses]

    def _rested(self, frames: np.ndarray) -> np.ndarray:
        """Frames with as much rest before the first as a node remembers: all roll-outs begin settled."""
        return np.concatenate([np.repeat(frames[:1], self.sizes.history, 0), frames])

    # learning --------------------------------------------------------------------------------------------------------
    def learn(self, keep: Callable[[], None]) -> None:
        """Update until done; `keep` is called between."""
        sizes = self.sizes
        progress = tqdm(initial=self.updates, total=sizes.updates, unit="update", file=sys.stderr)
        while self.updates < sizes.updates:
            for group in self.optimiser.param_groups:
                group["lr"] = sizes.learning_rate * sizes.decay ** (self.updates / sizes.updates)
            graphs, targets = zip(*(self._example(*self._drawn()) for _ in range(sizes.batch_size)))
            loss = torch.mean((self.network(beside(list(graphs))) - torch.cat(targets)) ** 2)
            self.optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), CLIP)
            self.optimiser.step()
            self.updates += 1
            self.losses.append(loss.item())
            progress.set_postfix(loss=f"{np.mean(self.losses):.3f}", refresh=False)
            progress.update()
            if self.updates % EVERY == 0 or self.updates == sizes.updates:
                keep()
        progress.close()

    def _drawn(self) -> tuple[int, int]:
        """A roll-out, and a frame of it that has enough before and one behind it."""
        k = int(self._rng.choice(self._learnt))
        return k, int(self._rng.integers(self.sizes.history, len(self._places[k]) - 1))

    def _example(self, k: int, t: int) -> tuple[Any, torch.Tensor]:
        """A frame whose past is given an error that walks, and what makes good for the last of it."""
        h = self.sizes.history
        places = self._places[k][t - h : t + 1]
        steps = self._rng.normal(0.0, self.sizes.noise / np.sqrt(h), places.shape) * self.scales.spread
        steps[0] = 0.0
        there = places + np.cumsum(steps, 0)
        wanted = self._places[k][t + 1] - 2.0 * there[-1] + there[-2]
        graph = graph_of(there, self._tools[k][t - h : t + 1], self.standing, self._tools[k][t + 1], self.scales,
                         self.sizes, self.floor)
        return graph, torch.as_tensor((wanted - self.scales.mean) / self.scales.spread, dtype=torch.float32)

    def state(self) -> dict[str, Any]:
        """What the next update depends on."""
        return {"weights": arrays(self.network), "optimiser": copy.deepcopy(self.optimiser.state_dict()),
                "updates": self.updates, "losses": list(self.losses), "rng": self._rng.bit_generator.state}

    def load(self, state: dict[str, Any]) -> None:
        """Return to a state."""
        self.network = filled(self.sizes, state["weights"])
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=self.sizes.learning_rate)
        self.optimiser.load_state_dict(state["optimiser"])
        self.updates = state["updates"]
        self.losses.clear()
        self.losses.extend(state["losses"])
        self._rng.bit_generator.state = state["rng"]

    # foreseeing ------------------------------------------------------------------------------------------------------
    def _next(self, places: np.ndarray, tools: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """Places (n, 3) a frame after the last of those given (history + 1, n, 3)."""
        graph = graph_of(places, tools, self.standing, ahead, self.scales, self.sizes, self.floor)
        with torch.no_grad():
            change = self.network(graph).double().numpy() * self.scales.spread + self.scales.mean
        new = 2.0 * places[-1] - places[-2] + change
        new[:, 2] = np.maximum(new[:, 2], self.floor)
        return new

    def foreseen(self, grains: np.ndarray, tools: np.ndarray) -> Iterator[np.ndarray]:
        """Places (n, 3) after each frame, from grains (n, 3) at rest and the tool's points in every frame (t, m, 3);
        ends early where they leave all bounds."""
        places, moving = self._rested(grains[None].astype(float)), self._rested(tools)
        for t in range(len(tools) - 1):
            new = self._next(places, moving[t : t + self.sizes.history + 1], tools[t + 1])
            if not np.abs(new).max() < FAR:  # also where it is no number
                return
            places = np.concatenate([places[1:], new[None]])
            yield new

    def way(self, start: Pose, hold: Hold, actions: np.ndarray) -> np.ndarray:
        """The tool's points (decisions + 1, m, 3) on the way that actions make it go."""
        hold.begin(start.position)
        poses = path(start, *hold.twists(actions), hold.dt)
        steps = np.minimum(hold.hold * np.arange(hold.n + 1), hold.steps)
        return np.einsum("tij,mj->tmi", poses.matrices[steps], self.tool) + poses.positions[steps, None]

    def errors(self) -> dict[str, float | None]:
        """On roll-outs that it has not seen: mean distance [m] of grains from where they are after a frame; of grains
        that are thought to go on as they do; and at the end of the roll-out, None where they leave all bounds."""
        one, end, straight, h = [], [], [], self.sizes.history
        for k in self.test:
            places, tools = self._places[k], self._tools[k]
            for t in range(h, len(places) - 1, TESTED):
                past, now = places[t - h : t + 1], places[t + 1]
                new = self._next(past, tools[t - h : t + 1], tools[t + 1])
                one.append(np.linalg.norm(new - now, axis=1).mean())
                straight.append(np.linalg.norm(2.0 * past[-1] - past[-2] - now, axis=1).mean())
            last = list(self.foreseen(places[h], tools[h:]))
            whole = len(last) == len(places) - h - 1
            end.append(np.linalg.norm(last[-1] - places[-1], axis=1).mean() if whole else np.inf)
        found = {"frame_m": one, "straight_on_m": straight, "end_m": end}
        return {name: float(np.mean(values)) if np.isfinite(values).all() else None for name, values in found.items()}
