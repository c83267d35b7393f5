"""Errors of a robot that episodes draw: in the simulated arm, not in what its controller knows."""

import numpy as np
import pytest
from grain_envs import make

pytestmark = pytest.mark.slow
RANGES = {"place_x": (0.02, 0.03), "place_yaw_deg": (10.0, 20.0), "mount_x": (0.003, 0.003), "mount_z_deg": (2.0, 2.0),
          "payload": (1.2, 1.2), "stiffness": (0.8, 0.8), "damping": (1.1, 1.1)}


@pytest.fixture(scope="module")
def env():
    """A scoop in an arm's hand over a container that stands elsewhere."""
    made = make("ScoopScoop", arm=True, obs=["tool", "wrist", "joints"], randomize=RANGES)
    yield made
    made.close()


def still(env, steps: int = 2) -> dict:
    for _ in range(steps):
        observation = env.step(np.zeros(6, np.float32))[0]
    return observation


def test_container_stands_where_the_field_has_it(env):
    env.reset(seed=1, options={"nominal": True})
    still(env, 1)
    body = env.carrier.cell.scene.model.body(env.task.container).id
    pose = env.solver.collider_pose(1)
    assert env.carrier.cell.data.xpos[body] == pytest.approx(pose.position, abs=1e-9)
    assert env.carrier.cell.data.xquat[body] == pytest.approx(pose.quaternion, abs=1e-9)
    assert pose.position[0] - env.task.containers[env.task.container].position[0] > 0.019


def test_robot_does_not_know_that_its_tool_sits_askew(env):
    """The tool is off by the error of its mounting; what the robot takes for its pose is the commanded one."""
    env.reset(seed=1, options={"nominal": True})
    seen = still(env)
    commanded, actual = env.carrier.commanded, env.solver.collider_pose(0)
    apart = commanded.inverse() @ actual
    assert apart.position[0] == pytest.approx(0.003, abs=5e-4)
    assert 2.0 * np.degrees(np.arccos(abs(apart.quaternion[0]))) == pytest.approx(2.0, abs=0.3)
    assert seen["tool"][:3] == pytest.approx(commanded.position, abs=1e-3)


def test_payload_and_gains_change_forces_and_return(env):
    """A heavier tool weighs more at the wrist and sags more; an episode without errors is that of an arm without."""
    env.reset(seed=1, options={"nominal": True})
    heavy, sag = still(env)["wrist"], env.carrier.arm_readings["tool_lag_max_m"]
    draw = env.reset(seed=1, options={"nominal": True})[1]["draw"]
    env.world.randomization.ranges |= dict.fromkeys(RANGES, (0.0, 1.2))
    none = dict.fromkeys(RANGES, 0.0) | dict.fromkeys(("payload", "stiffness", "damping"), 1.0)
    env.reset(options={"draw": draw | {"numbers": none}})
    light = still(env)["wrist"]
    assert np.linalg.norm(heavy[:3]) / np.linalg.norm(light[:3]) == pytest.approx(1.2, abs=0.02)
    assert sag > 1.5 * env.carrier.arm_readings["tool_lag_max_m"]

    plain = make("ScoopScoop", arm=True, obs=["tool", "wrist", "joints"], randomize={"place_x": (0.0, 0.0)})
    plain.reset(seed=1, options={"nominal": True})
    env.reset(options={"draw": draw | {"numbers": none}})
    free = still(env)
    for key, value in still(plain).items():
        np.testing.assert_allclose(value, free[key], rtol=1e-5, atol=1e-6)
    plain.close()
