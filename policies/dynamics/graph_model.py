"""The graph model of a sub-task: how its network learns from rollouts, and the rollouts that it predicts."""

import copy
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch

from mpm.geometry.rigid_motion import Pose
from mpm.rollout.tool_twists import integrate_twists
from policies.demonstrations.action_repeat import ActionRepeat
from policies.dynamics.graph_network import Graph, GraphNetwork, batch_graphs, make_graph, measure_scales
from policies.dynamics.rollouts import Rollouts
from policies.learning.presets import GraphSizes
from robosim.base.progress import Progress

TEST_EVERY = 10
"""One rollout in so many belongs to the test set."""
CHECKPOINT_EVERY = 250
"""Updates between two checkpoints."""
OUT_OF_BOUNDS = 10.0
"""Coordinate [m] beyond which a predicted rollout ends; a table-top scene is smaller."""


class GraphModel:
    """A graph network, its units, and the rigid bodies of its scene.
    surfaces: points of the tool and of the fixed bodies, as of `sample_surfaces`. floor: height [m] of the table."""

    def __init__(self, sizes: GraphSizes, rollouts: Rollouts, surfaces: tuple[np.ndarray, np.ndarray], floor: float,
                 seed: int) -> None:
        torch.manual_seed(seed)
        indices = range(len(rollouts.grains))
        self.training_set = [k for k in indices if k % TEST_EVERY]
        self.test_set = [k for k in indices if k % TEST_EVERY == 0]
        self.sizes, self.floor = sizes, floor
        self.scales = measure_scales([rollouts.grains[k] for k in self.training_set])
        self.network = GraphNetwork(sizes)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=sizes.learning_rate)
        self.tool, self.fixed = surfaces
        self.updates = 0
        self.losses: deque[float] = deque(maxlen=100)
        """Losses of the last updates."""
        self._rng = np.random.default_rng(seed)
        self._grains = [self._pad_history(grains.astype(float)) for grains in rollouts.grains]
        self._tools = [self._pad_history(np.stack([Pose(row[:3], row[3:]).apply(self.tool) for row in rows]))
                       for rows in rollouts.poses]

    def _pad_history(self, frames: np.ndarray) -> np.ndarray:
        """Repeat the first frame as often as the history is long: every rollout begins at rest."""
        return np.concatenate([np.repeat(frames[:1], self.sizes.history, 0), frames])

    # training --------------------------------------------------------------------------------------------------------
    def train(self, save: Callable[[], None]) -> None:
        """Make all remaining updates; `save` is called after every CHECKPOINT_EVERY and after the last."""
        sizes = self.sizes
        progress = Progress(initial=self.updates, total=sizes.updates, desc="graph network", unit="updates")
        while self.updates < sizes.updates:
            for group in self.optimiser.param_groups:
                group["lr"] = sizes.learning_rate * sizes.decay ** (self.updates / sizes.updates)
            graphs, targets = zip(*(self.make_example(*self._draw_frame()) for _ in range(sizes.batch_size)))
            loss = torch.mean((self.network(batch_graphs(list(graphs))) - torch.cat(targets)) ** 2)
            self.optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
            self.optimiser.step()
            self.updates += 1
            self.losses.append(loss.item())
            progress.set_postfix(loss=f"{np.mean(self.losses):.3f}", refresh=False)
            progress.update()
            if self.updates % CHECKPOINT_EVERY == 0 or self.updates == sizes.updates:
                save()
        progress.close()

    def _draw_frame(self) -> tuple[int, int]:
        """Draw a training rollout, and a frame with a full history and a next frame."""
        k = int(self._rng.choice(self.training_set))
        return k, int(self._rng.integers(self.sizes.history, len(self._grains[k]) - 1))

    def make_example(self, k: int, t: int) -> tuple[Graph, torch.Tensor]:
        """Return graph and target (n, 3) of frame t of rollout k (padded), with noise on its history.
        The noise is a random walk; the target corrects that of the last frame."""
        h = self.sizes.history
        history = self._grains[k][t - h : t + 1]
        noise = self._rng.normal(0.0, self.sizes.noise / np.sqrt(h), history.shape) * self.scales.spread
        noise[0] = 0.0
        noisy = history + np.cumsum(noise, 0)
        change = self._grains[k][t + 1] - 2.0 * noisy[-1] + noisy[-2]
        graph = make_graph(noisy, self._tools[k][t - h : t + 1], self.fixed, self._tools[k][t + 1], self.scales,
                           self.sizes, self.floor)
        return graph, torch.as_tensor((change - self.scales.mean) / self.scales.spread, dtype=torch.float32)

    def state(self) -> dict[str, Any]:
        """Return what the next update depends on."""
        return {"weights": self.network.weights(), "optimiser": copy.deepcopy(self.optimiser.state_dict()),
                "updates": self.updates, "losses": list(self.losses), "rng": self._rng.bit_generator.state}

    def load(self, state: dict[str, Any]) -> None:
        """Restore a state."""
        self.network.load_state_dict({name: torch.as_tensor(value) for name, value in state["weights"].items()})
        self.optimiser.load_state_dict(state["optimiser"])
        self.updates = state["updates"]
        self.losses = deque(state["losses"], maxlen=100)
        self._rng.bit_generator.state = state["rng"]

    # prediction ------------------------------------------------------------------------------------------------------
    def predict_frame(self, grains: np.ndarray, tool: np.ndarray, tool_next: np.ndarray) -> np.ndarray:
        """Return the grains' positions in the next frame [m], (n, 3).
        grains (history + 1, n, 3), tool (history + 1, m, 3): positions, the last of the present frame. tool_next
        (m, 3): of the next frame."""
        graph = make_graph(grains, tool, self.fixed, tool_next, self.scales, self.sizes, self.floor)
        with torch.no_grad():
            change = self.network(graph).double().numpy() * self.scales.spread + self.scales.mean
        positions = 2.0 * grains[-1] - grains[-2] + change
        positions[:, 2] = np.maximum(positions[:, 2], self.floor)
        return positions

    def predict_rollout(self, grains: np.ndarray, tool: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the grains' positions [m] (n, 3) in each frame after the first.
        grains (n, 3): in the first frame, at rest. tool (frames, m, 3): the tool's points. Ends early where positions
        leave OUT_OF_BOUNDS or are not finite."""
        history, tool_history = self._pad_history(grains[None].astype(float)), self._pad_history(tool)
        for t in range(len(tool) - 1):
            positions = self.predict_frame(history, tool_history[t : t + self.sizes.history + 1], tool[t + 1])
            if not np.abs(positions).max() < OUT_OF_BOUNDS:  # NaN compares as false
                return
            history = np.concatenate([history[1:], positions[None]])
            yield positions

    def tool_points(self, start: Pose, motion: ActionRepeat, actions: np.ndarray) -> np.ndarray:
        """Return the tool's points [m] (decisions + 1, m, 3) under actions (decisions, dimensions) from a pose."""
        motion.set_start(start.position)
        poses = integrate_twists(start, *motion.to_twists(actions), motion.dt)
        steps = np.minimum(motion.action_repeat * np.arange(motion.decisions + 1), motion.steps)
        return np.einsum("tij,mj->tmi", poses.matrices[steps], self.tool) + poses.positions[steps, None]

    def test_errors(self) -> dict[str, float | None]:
        """Return mean distances [m] between predicted and true positions on the test set.
        frame_m: after one frame. straight_on_m: the same of a prediction with constant displacement. end_m: at the end
        of the rollout; None where a prediction leaves OUT_OF_BOUNDS."""
        frame, end, constant, h = [], [], [], self.sizes.history
        for k in self.test_set:
            grains, tool = self._grains[k], self._tools[k]
            for t in range(h, len(grains) - 1, 5):
                history, truth = grains[t - h : t + 1], grains[t + 1]
                predicted = self.predict_frame(history, tool[t - h : t + 1], tool[t + 1])
                frame.append(np.linalg.norm(predicted - truth, axis=1).mean())
                constant.append(np.linalg.norm(2.0 * history[-1] - history[-2] - truth, axis=1).mean())
            rollout = list(self.predict_rollout(grains[h], tool[h:]))
            is_complete = len(rollout) == len(grains) - h - 1
            end.append(np.linalg.norm(rollout[-1] - grains[-1], axis=1).mean() if is_complete else np.inf)
        errors = {"frame_m": frame, "straight_on_m": constant, "end_m": end}
        return {name: float(np.mean(values)) if np.isfinite(values).all() else None for name, values in errors.items()}
