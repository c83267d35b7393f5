"""The network that foresees grains: symmetries, what it hears, and that it learns."""

import json

import numpy as np
import pytest
import torch

import mpm
from policies.dynamics import rollouts as frames
from policies.dynamics.graph_model import GraphModel
from policies.dynamics.graph_network import GraphNetwork, Scales, beside, filled, graph_of
from policies.learning.presets import GraphSizes, load_preset
from policies.methods.graph_search import cost
from policies.methods.train import train
from robosim.tasks.task import load_task

SIZES = GraphSizes(hidden=16, message_steps=2, history=2, neighbours=6, updates=300, batch_size=4)
SCALES = Scales(0.02, 0.003, np.zeros(3), np.full(3, 1e-3))


def scene(rng, n: int = 40):
    """Three frames of grains and of a tool, something that stands, and the tool's next place."""
    grains = rng.uniform(0.0, 0.06, (n, 3)) + 0.002 * rng.normal(size=(3, n, 3))
    tool = rng.uniform(0.0, 0.06, (10, 3)) + 0.001 * np.arange(3)[:, None, None]
    return grains, tool, rng.uniform(0.0, 0.06, (8, 3)), tool[-1] + 0.001


def said(network, grains, tool, standing, ahead) -> np.ndarray:
    with torch.no_grad():
        return network(graph_of(grains, tool, standing, ahead, SCALES, SIZES, 0.0)).numpy()


def test_order_and_place_do_not_matter():
    """Grains in another order move as they did; all of it elsewhere on the table, too; higher up not."""
    rng = np.random.default_rng(0)
    torch.manual_seed(0)
    network, (grains, tool, standing, ahead) = GraphNetwork(SIZES), scene(rng)
    usual, order = said(network, grains, tool, standing, ahead), rng.permutation(40)
    assert said(network, grains[:, order], tool, standing, ahead) == pytest.approx(usual[order], abs=1e-5)
    aside = np.array([0.3, -0.2, 0.0])
    there = said(network, grains + aside, tool + aside, standing + aside, ahead + aside)
    assert there == pytest.approx(usual, abs=1e-4)
    up = np.array([0.0, 0.0, 0.01])
    assert np.abs(said(network, grains + up, tool + up, standing + up, ahead + up) - usual).max() > 1e-3


def test_a_grain_hears_its_nearest_and_nobody_far():
    """Only grains hear, at most so many, never themselves, none out of reach; frames side by side do not mix."""
    rng = np.random.default_rng(1)
    graph = graph_of(*scene(rng), SCALES, SIZES, 0.0)
    receivers, senders = graph.receivers.numpy(), graph.senders.numpy()
    assert receivers.max() < 40 <= senders.max() and not np.any(receivers == senders)
    assert np.bincount(receivers).max() == SIZES.neighbours
    lengths = graph.edges[:, 3].numpy()
    assert lengths.max() <= 1.0 and lengths == pytest.approx(np.linalg.norm(graph.edges[:, :3], axis=1), abs=1e-6)
    network, other = GraphNetwork(SIZES), graph_of(*scene(rng, 25), SCALES, SIZES, 0.0)
    with torch.no_grad():
        both = network(beside([graph, other]))
        assert torch.allclose(both[:40], network(graph), atol=1e-6) and torch.allclose(both[40:], network(other),
                                                                                      atol=1e-6)


def dragged(rng, episodes: int = 20) -> frames.Rollouts:
    """Grains that fall a millimetre further in every frame, and in the next one go with a tool's point as near as
    15 mm; the tool goes aside at a speed of its own."""
    grains, poses = [], []
    for _ in range(episodes):
        x, v, speed = rng.uniform(0.0, 0.06, (20, 3)) + [0, 0, 0.2], np.zeros((20, 3)), rng.normal(0.0, 0.004, 3)
        tool = np.array([0.03, 0.03, 0.23])
        places, way = [], []
        for _ in range(12):
            places.append(x.copy())
            way.append([*tool, 1.0, 0.0, 0.0, 0.0])
            near = np.linalg.norm(x - tool, axis=1, keepdims=True) < 0.015
            v = np.where(near, speed, v - [0.0, 0.0, 1e-3])
            x, tool = x + v, tool + speed
        grains.append(np.array(places, np.float32))
        poses.append(np.array(way))
    return frames.Rollouts(grains, poses)


def test_a_network_learns_and_goes_on_where_it_was_cut():
    """On roll-outs that it has not seen the error of a frame is less than 0.7 of what the mean of all leaves, which it
    began with, and half of that of grains that go on straight. Cut after the first checkpoint, it ends with the same
    bits."""
    solids, sizes = [frames.Solid(np.zeros((5, 3)), True)], SIZES.model_copy(update={"updates": 500})
    rollouts = dragged(np.random.default_rng(2))
    model = GraphModel(sizes, rollouts, solids, 0.0, 0)
    before, kept = model.errors(), []
    model.learn(lambda: kept.append(model.state()))
    assert [state["updates"] for state in kept] == [250, 500]
    errors = model.errors()
    assert errors["frame_m"] < min(0.7 * before["frame_m"], 0.5 * errors["straight_on_m"]), (before, errors)
    half = GraphModel(sizes, rollouts, solids, 0.0, 5)
    half.load(kept[0])
    half.learn(lambda: None)
    for name, value in model.network.state_dict().items():
        assert torch.equal(value, half.network.state_dict()[name])
    assert torch.equal(filled(sizes, kept[1]["weights"]).say[0].weight, model.network.say[0].weight)


def test_the_past_is_given_an_error_and_what_is_asked_for_makes_good():
    """It grows along the past to its size; without it the target is the change of the change of place."""
    rollouts, solids = dragged(np.random.default_rng(3), 4), [frames.Solid(np.zeros((5, 3)), True)]
    exact = GraphModel(SIZES.model_copy(update={"noise": 0.0}), rollouts, solids, 0.0, 0)
    _, target = exact._example(1, 6)  # the sixth is the fourth, after a rest of two
    x = rollouts.grains[1].astype(float)
    wanted = (x[5] - 2.0 * x[4] + x[3] - exact.scales.mean) / exact.scales.spread
    assert target.numpy() == pytest.approx(wanted, abs=1e-4)
    noisy = GraphModel(SIZES.model_copy(update={"noise": 0.5}), rollouts, solids, 0.0, 0)
    off = []
    for _ in range(300):
        graph, _ = noisy._example(1, 6)
        off.append((graph.nodes[:20, 3:6].numpy() - exact._example(1, 6)[0].nodes[:20, 3:6].numpy())
                   * exact.scales.step / exact.scales.spread)
    assert np.std(off) == pytest.approx(0.5 / np.sqrt(2.0), rel=0.05)  # of the last of two steps


def test_what_is_foreseen_ends_where_it_leaves_all_bounds():
    """Instead of a tree over numbers that are none."""
    model = GraphModel(SIZES, dragged(np.random.default_rng(4), 3), [frames.Solid(np.zeros((5, 3)), True)], 0.0, 0)
    for parameter in model.network.say.parameters():
        parameter.data.fill_(1e9)
    assert list(model.foreseen(np.zeros((4, 3)), np.zeros((9, 5, 3)))) == []
    assert model.errors()["end_m"] is None


def test_what_is_searched_for_is_what_the_reward_takes():
    """Nothing for grains on the goal and a tool turned as asked; only the nearest count where elites do."""
    carry, scoop = load_task("SpoonTranslate"), load_task("SpoonScoop")
    there = np.tile(carry.goal, (5, 1))
    assert cost(carry, there, 0.0) == 0.0
    aside = there + [0.1, 0.0, 0.0]
    expected = carry.reward.distance.total / carry.reward.distance.reference * 0.1 * carry.reward.distance.weights[0]
    assert cost(carry, aside, 1.0) == pytest.approx(expected)
    grains = np.tile(scoop.goal, (288, 1))
    grains[30:] += 0.5
    assert cost(scoop, grains, np.radians(-110.0)) == pytest.approx(0.0, abs=1e-9)
    assert cost(scoop, grains, np.radians(-100.0)) == pytest.approx(scoop.reward.turn.scale * np.radians(10.0))


def test_roll_outs_are_kept_and_recognised(tmp_path):
    """Grains move and differ from roll-out to roll-out; what is there is not made again; other roll-outs, and methods
    that take none, are refused."""
    assert frames.frames("SpoonTranslate", tmp_path, episodes=2, hold=100) == 0
    env = frames.environment("SpoonTranslate", None, 100)
    found = frames.read(tmp_path, env)
    assert [places.shape for places in found.grains] == [(11, 205, 3)] * 2 and found.poses[0].shape == (11, 7)
    moved = [np.linalg.norm(np.diff(places, axis=0), axis=2).max() for places in found.grains]
    assert min(moved) > 1e-3 and not np.allclose(found.poses[0], found.poses[1])
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert frames.frames("SpoonTranslate", tmp_path, episodes=2, hold=100) == 0
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    with pytest.raises(mpm.InvalidValue, match="holds roll-outs of"):
        frames.frames("SpoonTranslate", tmp_path, episodes=2, hold=100, seed=1)
    env.action_repeat = 10
    with pytest.raises(mpm.InvalidValue, match="of another environment: hold 100, now 10"):
        frames.read(tmp_path, env)
    with pytest.raises(mpm.InvalidValue, match="give their folder as --frames"):
        train("gnn_cmaes", "SpoonTranslate", tmp_path / "run")
    with pytest.raises(mpm.InvalidValue, match="plans one motion"):
        train("gnn_cmaes", "SpoonTranslate", tmp_path / "run", frames=tmp_path, hold=100, starts="random")
    with pytest.raises(mpm.InvalidValue, match="this method takes no roll-outs"):
        train("sac", "Pendulum-v1", tmp_path / "run", frames=tmp_path)


@pytest.mark.slow
def test_a_network_plans_among_grains(tmp_path):
    """Roll-outs, learning, search and the true simulator, end to end; the same command again changes nothing."""
    frames.frames("SpoonTranslate", tmp_path / "frames", episodes=4, hold=20)
    preset = load_preset("gnn_cmaes")
    small = preset.graph.model_copy(update={"updates": 50, "message_steps": 1})
    file = tmp_path / "small.yaml"
    file.write_text(json.dumps(preset.model_copy(update={"graph": small, "episodes": 2}).model_dump()))
    out = tmp_path / "run"
    for _ in range(2):
        assert train(str(file), "SpoonTranslate", out, hold=20, frames=tmp_path / "frames") == 0
    status, network = (json.loads((out / name).read_text()) for name in ("status.json", "network.json"))
    assert status["state"] == "finished" and status["episodes"] == 2 and network["updates"] == 50
    assert status["replayed"]["return"] == pytest.approx(status["best_return"], abs=1e-9)
    assert all(np.isfinite(value) for value in network["errors"].values())
