"""A network that moves grains as a graph: nodes pass messages to those near them (Sanchez-Gonzalez et al. 2020; for
grains that are scooped and poured, Tuomainen et al. 2022). What is rigid takes part as points whose way is known."""

from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import nn

from policies.learning.presets import GraphSizes

KINDS = 3
"""Grain, what moves, what stands."""
NEAR = 2.5
"""Reach of a message over the distance to a grain's fifth neighbour."""


class Scales(NamedTuple):
    """Units of what a network sees and says, found in its roll-outs."""

    reach: float
    """[m] of a message."""
    step: float
    """Standard deviation of the grains' change of place in a frame [m]."""
    mean: np.ndarray
    """(3,) of the change of that [m]."""
    spread: np.ndarray
    """(3,) standard deviation of the same."""


class Graph(NamedTuple):
    """One frame, or several beside each other."""

    nodes: torch.Tensor
    """(n, features), grains first within each frame."""
    edges: torch.Tensor
    """(m, 4) from sender to receiver, in reaches, and its length."""
    senders: torch.Tensor
    receivers: torch.Tensor
    grains: torch.Tensor
    """Indices of the nodes that are grains."""


def layers(into: int, hidden: int, out: int, *, normed: bool = True) -> nn.Sequential:
    """A network of two layers."""
    parts: list[nn.Module] = [nn.Linear(into, hidden), nn.ReLU(), nn.Linear(hidden, out)]
    return nn.Sequential(*parts, *([nn.LayerNorm(out)] if normed else []))


class GraphNetwork(nn.Module):
    """Says how the change of place of every grain changes, in units of `Scales`."""

    def __init__(self, sizes: GraphSizes) -> None:
        super().__init__()
        h = sizes.hidden
        self.node = layers(3 * sizes.history + KINDS + 4, h, h)
        self.edge = layers(4, h, h)
        self.hear = nn.ModuleList(layers(3 * h, h, h) for _ in range(sizes.message_steps))
        self.move = nn.ModuleList(layers(2 * h, h, h) for _ in range(sizes.message_steps))
        self.say = layers(h, h, 3, normed=False)

    def forward(self, graph: Graph) -> torch.Tensor:
        """(grains, 3)"""
        node, edge = self.node(graph.nodes), self.edge(graph.edges)
        for hear, move in zip(self.hear, self.move):
            edge = edge + hear(torch.cat((edge, node[graph.senders], node[graph.receivers]), 1))
            heard = torch.zeros_like(node).index_add_(0, graph.receivers, edge)
            node = node + move(torch.cat((node, heard), 1))
        return self.say(node[graph.grains])


def graph_of(places: np.ndarray, moving: np.ndarray, standing: np.ndarray, ahead: np.ndarray, scales: Scales,
             sizes: GraphSizes, floor: float) -> Graph:
    """The graph of one frame.

    places (history + 1, n, 3), moving (history + 1, m, 3): of grains and of what moves, the last now; standing (k, 3);
    ahead (m, 3): where what moves is next; floor: height [m] of the table.
    """
    now = np.concatenate([places[-1], moving[-1], standing])
    n, m, k = places.shape[1], moving.shape[1], len(standing)
    past = np.concatenate([np.diff(places, axis=0), np.diff(moving, axis=0), np.zeros((len(places) - 1, k, 3))], 1)
    known = np.zeros((len(now), 3))
    known[n : n + m] = ahead - moving[-1]
    kind = np.repeat(np.eye(KINDS), (n, m, k), 0)
    height = np.clip((now[:, 2:] - floor) / scales.reach, 0.0, 2.0)
    features = np.concatenate([past.transpose(1, 0, 2).reshape(len(now), -1) / scales.step, known / scales.step, kind,
                               height], 1)
    near, who = map(np.asarray, KDTree(now).query(now[:n], k=sizes.neighbours + 1, distance_upper_bound=scales.reach))
    receivers, place = np.nonzero(np.isfinite(near[:, 1:]))  # the nearest is the grain itself
    senders = who[receivers, place + 1]
    way = (now[receivers] - now[senders]) / scales.reach
    edges = np.concatenate([way, np.linalg.norm(way, axis=1, keepdims=True)], 1)
    return Graph(*(torch.as_tensor(a, dtype=torch.float32) for a in (features, edges)),
                 *(torch.as_tensor(a) for a in (senders, receivers, np.arange(n))))


def beside(graphs: list[Graph]) -> Graph:
    """Several graphs as one that has no edges between them."""
    firsts = np.cumsum([0, *(len(graph.nodes) for graph in graphs[:-1])])
    return Graph(torch.cat([g.nodes for g in graphs]), torch.cat([g.edges for g in graphs]),
                 *(torch.cat([getattr(g, name) + int(first) for g, first in zip(graphs, firsts)])
                   for name in ("senders", "receivers", "grains")))


def scales_of(grains: list[np.ndarray]) -> Scales:
    """Units in which the roll-outs' grains are near each other, and move."""
    steps = [np.diff(places, axis=0) for places in grains]
    turns = np.concatenate([np.diff(step, axis=0).reshape(-1, 3) for step in steps])
    near = [np.median(KDTree(places[0]).query(places[0], k=6)[0][:, -1]) for places in grains]
    return Scales(NEAR * float(np.median(near)), float(np.concatenate([s.reshape(-1, 3) for s in steps]).std()),
                  turns.mean(0), turns.std(0) + 1e-9)


def arrays(network: GraphNetwork) -> dict[str, np.ndarray]:
    """The weights."""
    return {name: value.detach().numpy().copy() for name, value in network.state_dict().items()}


def filled(sizes: GraphSizes, weights: dict[str, Any]) -> GraphNetwork:
    """A network with these weights."""
    network = GraphNetwork(sizes)
    network.load_state_dict({name: torch.as_tensor(value) for name, value in weights.items()})
    return network
