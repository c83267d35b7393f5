"""Policies that move the arm in a rehearsal: where they take the tool, and files that are refused by name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bundled import rehearsal

from robosim.base.errors import ConfigError
from robosim.planning.plan import plan_motion
from robosim.planning.recorded_motions import load_sequence
from robosim.rehearsal.run import RehearsalRun
from robosim.rehearsal.session import check_config
from robosim.studies.evaluation.policy_driver import REST_TIME, PolicyDriver
from robosim.tasks.task import load_task


def write_policy(folder: Path, **changed: Any) -> Path:
    """Write a network of ShovelMove that gives one action whatever it sees; return its folder."""
    arrays = {"weight_0": np.zeros((3, 39), np.float32), "bias_0": np.array([0.0, 0.2, 0.0], np.float32),
              "bound": "clip", "activations": ["none"], "obs": "goal_frame,pending,time", "task": "ShovelMove",
              "action_repeat": 10, "task_table": load_task("ShovelMove").model_dump_json(exclude={"description"})}
    np.savez(folder / "best_policy.npz", **(arrays | changed))
    return folder


@pytest.mark.long
def test_a_constant_action_takes_the_tool_there_in_a_straight_line(tmp_path: Path) -> None:
    """From the task's start, translated to where the rehearsal has its pile, and after a rest."""
    plan = plan_motion(check_config(rehearsal("shovel", trajectory="recorded")))
    run = RehearsalRun(plan, driver=PolicyDriver(write_policy(tmp_path), plan.config))
    task, begin, dt = load_task("ShovelMove"), plan.config.grasp_time + REST_TIME, plan.config.host_dt
    start = np.array(task.start.position) + load_sequence(plan.config)[0].offset
    assert run.passages() == [(begin, "ShovelMove")]
    for k in range(round(run.driver.duration / dt)):
        place = plan.arm.tool_pose(run.driver.command(k * dt).q).position
        gone = min(max(k * dt - begin, 0.0), task.steps * task.step_dt) * 0.2 * task.action.speed
        assert place == pytest.approx(start + [0.0, gone, 0.0], abs=2e-3)
    assert place == pytest.approx(start + [0.0, gone, 0.0], abs=1e-5)


@pytest.mark.parametrize(("name", "changed", "message"), [
    ("shovel", {"obs": "goal_frame,height_map"}, "best_policy.npz: sees height_map; accepted in a rehearsal: goal_"),
    ("shovel", {"task_table": '{"steps": 1}'}, "learned on ShovelMove with .*steps 1, here 1000"),
    ("spoon", {}, "no policy for SpoonScoop; accepted: a folder with SpoonScoop.npz and so on")])
def test_a_policy_is_refused_by_name(tmp_path: Path, name: str, changed: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        PolicyDriver(write_policy(tmp_path, **changed), rehearsal(name, trajectory="recorded"))
