"""A graph network that predicts the motion of grains by message passing between neighbours.
Rigid bodies take part as points on their surfaces, whose motion is prescribed. Source: Sanchez-Gonzalez et al. 2020;
for scooping and pouring Tuomainen et al. 2022."""

from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import nn

from policies.learning.presets import GraphSizes

KINDS = 3
"""Kinds of node: grain, moving rigid point, fixed rigid point."""
RADIUS_OVER_SPACING = 2.5
"""Connectivity radius divided by the distance to a grain's fifth neighbour."""
POINTS = 150
"""Largest number of points of a body."""
SAMPLES = 200_000
"""Random points in a body's bounding box, of which those near its surface are kept."""
NEAR_SURFACE = 0.02
"""Largest distance from the surface, as a fraction of the bounding box's diagonal."""


class Scales(NamedTuple):
    """Units of the network's inputs and outputs, measured in its rollouts."""

    reach: float
    """Connectivity radius [m]."""
    step: float
    """Standard deviation of the grains' displacement in a frame [m]."""
    mean: np.ndarray
    """Mean of the change of displacement between frames [m], (3,)."""
    spread: np.ndarray
    """Standard deviation of the same [m], (3,)."""


class Graph(NamedTuple):
    """The graph of one frame, or of several without edges between them."""

    nodes: torch.Tensor
    """(n, features), grains first within each frame."""
    edges: torch.Tensor
    """(m, 4): vector from receiver to sender in units of the connectivity radius, and its length."""
    senders: torch.Tensor
    """Indices of nodes (m,)."""
    receivers: torch.Tensor
    """Indices of nodes (m,)."""
    grains: torch.Tensor
    """Indices of the nodes that are grains."""


def make_mlp(inputs: int, hidden: int, outputs: int, *, layer_norm: bool = True) -> nn.Sequential:
    """Return a network of two layers, with layer normalisation of its output."""
    parts: list[nn.Module] = [nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, outputs)]
    return nn.Sequential(*parts, *([nn.LayerNorm(outputs)] if layer_norm else []))


class GraphNetwork(nn.Module):
    """Predicts each grain's change of displacement, in units of `Scales`."""

    def __init__(self, sizes: GraphSizes) -> None:
        super().__init__()
        h = sizes.hidden
        self.node_encoder = make_mlp(3 * sizes.history + KINDS + 4, h, h)
        self.edge_encoder = make_mlp(4, h, h)
        self.edge_update = nn.ModuleList(make_mlp(3 * h, h, h) for _ in range(sizes.message_steps))
        self.node_update = nn.ModuleList(make_mlp(2 * h, h, h) for _ in range(sizes.message_steps))
        self.decoder = make_mlp(h, h, 3, layer_norm=False)

    def forward(self, graph: Graph) -> torch.Tensor:
        """Return predictions (grains, 3)."""
        nodes, edges = self.node_encoder(graph.nodes), self.edge_encoder(graph.edges)
        for edge_update, node_update in zip(self.edge_update, self.node_update):
            edges = edges + edge_update(torch.cat((edges, nodes[graph.senders], nodes[graph.receivers]), 1))
            messages = torch.zeros_like(nodes).index_add_(0, graph.receivers, edges)
            nodes = nodes + node_update(torch.cat((nodes, messages), 1))
        return self.decoder(nodes[graph.grains])

    def weights(self) -> dict[str, np.ndarray]:
        """Return copies of the weights."""
        return {name: value.detach().numpy().copy() for name, value in self.state_dict().items()}


def make_graph(grains: np.ndarray, moving: np.ndarray, fixed: np.ndarray, moving_next: np.ndarray, scales: Scales,
               sizes: GraphSizes, floor: float) -> Graph:
    """Return the graph of one frame.
    grains (history + 1, n, 3), moving (history + 1, m, 3): positions [m], the last of the present frame. fixed (k, 3):
    of fixed rigid points. moving_next (m, 3): of moving points in the next frame. floor: height [m] of the table."""
    positions = np.concatenate([grains[-1], moving[-1], fixed])
    n, m, k = grains.shape[1], moving.shape[1], len(fixed)
    displacements = np.concatenate([np.diff(grains, axis=0), np.diff(moving, axis=0),
                                    np.zeros((len(grains) - 1, k, 3))], 1)
    prescribed = np.zeros((len(positions), 3))
    prescribed[n : n + m] = moving_next - moving[-1]
    kind = np.repeat(np.eye(KINDS), (n, m, k), 0)
    height = np.clip((positions[:, 2:] - floor) / scales.reach, 0.0, 2.0)
    features = np.concatenate([displacements.transpose(1, 0, 2).reshape(len(positions), -1) / scales.step,
                               prescribed / scales.step, kind, height], 1)
    distances, neighbours = map(np.asarray, KDTree(positions).query(
        positions[:n], k=sizes.neighbours + 1, distance_upper_bound=scales.reach))
    receivers, column = np.nonzero(np.isfinite(distances[:, 1:]))  # column 0 is the grain itself
    senders = neighbours[receivers, column + 1]
    vectors = (positions[receivers] - positions[senders]) / scales.reach
    edges = np.concatenate([vectors, np.linalg.norm(vectors, axis=1, keepdims=True)], 1)
    return Graph(*(torch.as_tensor(a, dtype=torch.float32) for a in (features, edges)),
                 *(torch.as_tensor(a) for a in (senders, receivers, np.arange(n))))


def batch_graphs(graphs: list[Graph]) -> Graph:
    """Return several graphs as one, without edges between them."""
    offsets = np.cumsum([0, *(len(graph.nodes) for graph in graphs[:-1])])
    return Graph(torch.cat([g.nodes for g in graphs]), torch.cat([g.edges for g in graphs]),
                 *(torch.cat([getattr(g, name) + int(offset) for g, offset in zip(graphs, offsets)])
                   for name in ("senders", "receivers", "grains")))


def measure_scales(rollouts: list[np.ndarray]) -> Scales:
    """Return the units of rollouts (frames, n, 3) of grains."""
    displacements = [np.diff(positions, axis=0) for positions in rollouts]
    changes = np.concatenate([np.diff(one, axis=0).reshape(-1, 3) for one in displacements])
    spacings = [np.median(KDTree(positions[0]).query(positions[0], k=6)[0][:, -1]) for positions in rollouts]
    return Scales(RADIUS_OVER_SPACING * float(np.median(spacings)),
                  float(np.concatenate([one.reshape(-1, 3) for one in displacements]).std()),
                  changes.mean(0), changes.std(0) + 1e-9)


def sample_surfaces(env: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return points near the surface of the tool (m, 3) [m], in its own frame, and of the fixed bodies (k, 3) [m]."""
    surfaces, rng = [], np.random.default_rng(0)
    for index, collider in enumerate(env.solver.colliders):
        lower, upper = collider.sdf.bounds
        samples = rng.uniform(lower, upper, (SAMPLES, 3))
        is_near = np.abs(collider.sdf.distance(samples)) < NEAR_SURFACE * np.linalg.norm(upper - lower)
        points = samples[is_near][:POINTS]
        surfaces.append(env.solver.collider_pose(index).apply(points) if index else points)
    return surfaces[0], np.concatenate([np.zeros((0, 3)), *surfaces[1:]])
