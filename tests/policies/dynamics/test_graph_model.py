"""The graph model of grains: symmetries, connectivity, training; its rollouts and the search with it."""

import json

import numpy as np
import pytest
import torch

import mpm
from policies.dynamics.graph_model import GraphModel
from policies.dynamics.graph_network import GraphNetwork, Scales, batch_graphs, make_graph
from policies.dynamics.rollouts import Rollouts, cached_environment, make_rollouts, read_rollouts
from policies.learning.options import TrainingOptions
from policies.learning.presets import GraphSizes, load_preset
from policies.methods.graph_search import cost
from policies.methods.train import train
from robosim.tasks.task import load_task

SIZES = GraphSizes(hidden=16, message_steps=2, history=2, neighbours=6, updates=300, batch_size=4)
SURFACES = np.zeros((5, 3)), np.zeros((0, 3))
SCALES = Scales(0.02, 0.003, np.zeros(3), np.full(3, 1e-3))


def make_scene(rng, n: int = 40):
    """Three frames of grains and of a tool, fixed points, and the tool's next points."""
    grains = rng.uniform(0.0, 0.06, (n, 3)) + 0.002 * rng.normal(size=(3, n, 3))
    tool = rng.uniform(0.0, 0.06, (10, 3)) + 0.001 * np.arange(3)[:, None, None]
    return grains, tool, rng.uniform(0.0, 0.06, (8, 3)), tool[-1] + 0.001


def predict(network, grains, tool, fixed, moving_next) -> np.ndarray:
    with torch.no_grad():
        return network(make_graph(grains, tool, fixed, moving_next, SCALES, SIZES, 0.0)).numpy()


def test_predictions_are_permutation_and_translation_invariant():
    """In the grains' order and along the table; not in height."""
    rng = np.random.default_rng(0)
    torch.manual_seed(0)
    network, (grains, tool, fixed, moving_next) = GraphNetwork(SIZES), make_scene(rng)
    usual, order = predict(network, grains, tool, fixed, moving_next), rng.permutation(40)
    assert predict(network, grains[:, order], tool, fixed, moving_next) == pytest.approx(usual[order], abs=1e-5)
    offset = np.array([0.3, -0.2, 0.0])
    translated = predict(network, grains + offset, tool + offset, fixed + offset, moving_next + offset)
    assert translated == pytest.approx(usual, abs=1e-4)
    up = np.array([0.0, 0.0, 0.01])
    assert np.abs(predict(network, grains + up, tool + up, fixed + up, moving_next + up) - usual).max() > 1e-3


def test_edges_connect_grains_to_their_nearest_neighbours():
    """Only grains receive, at most `neighbours` edges, none from itself or from outside the radius; graphs of a batch
    are independent."""
    rng = np.random.default_rng(1)
    graph = make_graph(*make_scene(rng), SCALES, SIZES, 0.0)
    receivers, senders = graph.receivers.numpy(), graph.senders.numpy()
    assert receivers.max() < 40 <= senders.max() and not np.any(receivers == senders)
    assert np.bincount(receivers).max() == SIZES.neighbours
    lengths = graph.edges[:, 3].numpy()
    assert lengths.max() <= 1.0 and lengths == pytest.approx(np.linalg.norm(graph.edges[:, :3], axis=1), abs=1e-6)
    network, other = GraphNetwork(SIZES), make_graph(*make_scene(rng, 25), SCALES, SIZES, 0.0)
    with torch.no_grad():
        both = network(batch_graphs([graph, other]))
        assert torch.allclose(both[:40], network(graph), atol=1e-6) and torch.allclose(both[40:], network(other),
                                                                                      atol=1e-6)


def make_dragged(rng, episodes: int = 20) -> Rollouts:
    """Grains that accelerate downwards by a millimetre a frame, or have the velocity of a tool's point within 15 mm;
    the tool has a constant random velocity."""
    grains, poses = [], []
    for _ in range(episodes):
        x, v, speed = rng.uniform(0.0, 0.06, (20, 3)) + [0, 0, 0.2], np.zeros((20, 3)), rng.normal(0.0, 0.004, 3)
        tool = np.array([0.03, 0.03, 0.23])
        positions, tool_poses = [], []
        for _ in range(12):
            positions.append(x.copy())
            tool_poses.append([*tool, 1.0, 0.0, 0.0, 0.0])
            near = np.linalg.norm(x - tool, axis=1, keepdims=True) < 0.015
            v = np.where(near, speed, v - [0.0, 0.0, 1e-3])
            x, tool = x + v, tool + speed
        grains.append(np.array(positions, np.float32))
        poses.append(np.array(tool_poses))
    return Rollouts(grains, poses)


@pytest.mark.long
def test_a_network_learns_and_continues_from_a_checkpoint():
    """On the test set the error of a frame is less than 0.7 x that before training, which predicts the mean, and less
    than half of that of constant velocity. Continued from the first checkpoint, it ends with the same bits."""
    sizes = SIZES.model_copy(update={"updates": 500})
    rollouts = make_dragged(np.random.default_rng(2))
    model = GraphModel(sizes, rollouts, SURFACES, 0.0, 0)
    before, states = model.test_errors(), []
    model.train(lambda: states.append(model.state()))
    assert [state["updates"] for state in states] == [250, 500]
    errors = model.test_errors()
    assert errors["frame_m"] < min(0.7 * before["frame_m"], 0.5 * errors["straight_on_m"]), (before, errors)
    half = GraphModel(sizes, rollouts, SURFACES, 0.0, 5)
    half.load(states[0])
    half.train(lambda: None)
    for name, value in model.network.state_dict().items():
        assert torch.equal(value, half.network.state_dict()[name])
    assert np.array_equal(states[1]["weights"]["decoder.0.weight"], model.network.weights()["decoder.0.weight"])


def test_noise_of_the_history_and_its_correction():
    """The noise grows along the history to its size; the target corrects that of the last frame; without noise it is
    the change of displacement."""
    rollouts = make_dragged(np.random.default_rng(3), 4)
    exact = GraphModel(SIZES.model_copy(update={"noise": 0.0}), rollouts, SURFACES, 0.0, 0)
    _, target = exact.make_example(1, 6)  # frame 6 of the padded rollout is frame 4
    x = rollouts.grains[1].astype(float)
    change = (x[5] - 2.0 * x[4] + x[3] - exact.scales.mean) / exact.scales.spread
    assert target.numpy() == pytest.approx(change, abs=1e-4)
    noisy = GraphModel(SIZES.model_copy(update={"noise": 0.5}), rollouts, SURFACES, 0.0, 0)
    noise = []
    for _ in range(300):
        graph, _ = noisy.make_example(1, 6)
        noise.append((graph.nodes[:20, 3:6].numpy() - exact.make_example(1, 6)[0].nodes[:20, 3:6].numpy())
                   * exact.scales.step / exact.scales.spread)
    assert np.std(noise) == pytest.approx(0.5 / np.sqrt(2.0), rel=0.05)  # of the last of two displacements


def test_a_prediction_ends_where_it_leaves_its_bounds():
    """Before neighbours are searched among positions that are not finite."""
    model = GraphModel(SIZES, make_dragged(np.random.default_rng(4), 3), SURFACES, 0.0, 0)
    for parameter in model.network.decoder.parameters():
        parameter.data.fill_(1e9)
    assert list(model.predict_rollout(np.zeros((4, 3)), np.zeros((9, 5, 3)))) == []
    assert model.test_errors()["end_m"] is None


def test_cost_of_the_search_is_the_penalty_of_the_reward():
    """Zero for grains at the goal and a tool at its angle; only the nearest grains count where there are elites."""
    carry, scoop = load_task("SpoonTranslate"), load_task("SpoonScoop")
    at_goal = np.tile(carry.goal, (5, 1))
    assert cost(carry, at_goal, 0.0) == 0.0
    beside_goal = at_goal + [0.1, 0.0, 0.0]
    distance = carry.reward["distance"]
    expected = distance.total / distance.reference * 0.1 * distance.weights[0]
    assert cost(carry, beside_goal, 1.0) == pytest.approx(expected)
    grains = np.tile(scoop.goal, (288, 1))
    grains[30:] += 0.5
    assert cost(scoop, grains, np.radians(-110.0)) == pytest.approx(0.0, abs=1e-9)
    assert cost(scoop, grains, np.radians(-100.0)) == pytest.approx(scoop.reward["turn"].scale * np.radians(10.0))


@pytest.mark.long
def test_rollouts_are_stored_and_recognised(tmp_path):
    """Grains move and differ between rollouts; stored ones are not made again; other rollouts, and methods that take
    none, are refused."""
    assert make_rollouts("SpoonTranslate", tmp_path, episodes=2, action_repeat=100) == 0
    env = cached_environment("SpoonTranslate", None, 100)
    rollouts = read_rollouts(tmp_path, env)
    assert [grains.shape for grains in rollouts.grains] == [(11, 205, 3)] * 2 and rollouts.poses[0].shape == (11, 7)
    moved = [np.linalg.norm(np.diff(grains, axis=0), axis=2).max() for grains in rollouts.grains]
    assert min(moved) > 1e-3 and not np.allclose(rollouts.poses[0], rollouts.poses[1])
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert make_rollouts("SpoonTranslate", tmp_path, episodes=2, action_repeat=100) == 0
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    with pytest.raises(mpm.InvalidValue, match="holds rollouts of"):
        make_rollouts("SpoonTranslate", tmp_path, episodes=2, action_repeat=100, seed=1)
    env.action_repeat = 10
    with pytest.raises(mpm.InvalidValue, match="of another environment: action_repeat 100, now 10"):
        read_rollouts(tmp_path, env)
    with pytest.raises(mpm.InvalidValue, match="give their folder as --rollouts"):
        train("gnn_cmaes", "SpoonTranslate", tmp_path / "run", TrainingOptions())
    with pytest.raises(mpm.InvalidValue, match="plans one motion"):
        train("gnn_cmaes", "SpoonTranslate", tmp_path / "run",
              TrainingOptions(rollouts=tmp_path, action_repeat=100, starts="random"))
    with pytest.raises(mpm.InvalidValue, match="this method takes no rollouts"):
        train("sac", "Pendulum-v1", tmp_path / "run", TrainingOptions(rollouts=tmp_path))


@pytest.mark.slow
def test_planning_with_a_network(tmp_path):
    """Rollouts, training, search and simulator, end to end; the same command again changes nothing."""
    make_rollouts("SpoonTranslate", tmp_path / "rollouts", episodes=2, action_repeat=250)
    preset = load_preset("gnn_cmaes")
    small = preset.graph.model_copy(update={"updates": 5, "message_steps": 1})
    file = tmp_path / "small.yaml"
    changes = {"graph": small, "episodes": 2, "options": {**preset.options, "population": 4}}
    file.write_text(json.dumps(preset.model_copy(update=changes).model_dump()))
    out = tmp_path / "run"
    for _ in range(2):
        assert train(str(file), "SpoonTranslate", out,
                     TrainingOptions(action_repeat=250, rollouts=tmp_path / "rollouts")) == 0
    status, network = (json.loads((out / name).read_text()) for name in ("status.json", "network.json"))
    assert status["state"] == "finished" and status["episodes"] == 2 and network["updates"] == 5
    assert status["replayed"]["return"] == pytest.approx(status["best_return"], abs=1e-9)
    assert all(np.isfinite(value) for value in network["errors"].values())
