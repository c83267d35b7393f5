"""The worked example of an arm of one's own: its steps, from a ROS package that is none of ours to an accepted run."""

import json
import re
import shlex
from pathlib import Path

import pytest
from own_arm import write_description
from own_meshes import write_bowl, write_ladle
from pages import ROOT

from robosim import Rehearsal
from robosim.commands.main import main

PAGE = (ROOT / "docs" / "guides" / "own_robot_example.md").read_text()
TREE, NEW, LISTED, LIMITS, LADLE, SALT, REHEARSE, PRINTED = re.findall(r"^```\w+\n(.*?)^```", PAGE, re.M | re.S)
pytestmark = pytest.mark.filterwarnings("ignore:.*visual shapes are left out")
MOST_LINES, MOST_PLAN_TIME = 30, 20.0
"""What a person writes; seconds."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    """A folder in which all was done but the last command; what is printed on the way is what the page shows."""
    write_description(tmp_path)
    write_ladle(tmp_path / "ladle.stl")
    write_bowl(tmp_path / "bowl.stl")
    for line in TREE.splitlines():
        assert all(list(tmp_path.glob(name)) for name in line.split("  ")[0].split(", ")), line
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(NEW)[1:]) == 0
    assert capsys.readouterr().out == LISTED
    arm = Path(LISTED.splitlines()[-1])
    for key, value in re.findall(r"^( *\w+): +(\S.*)$", LIMITS, re.M):
        text, count = re.subn(rf"^{key}: .*$", f"{key}: {value}", arm.read_text(), flags=re.M)
        assert count == 1 and arm.write_text(text)
    Path("ladle.yaml").write_text(LADLE)
    Path("salt.yaml").write_text(SALT)
    return tmp_path


def test_it_is_short_and_leads_to_a_plan(folder: Path) -> None:
    """The limits are those of the URDF and of the page; the arm keeps clear of things."""
    assert sum(len(text.splitlines()) for text in (LIMITS, LADLE, SALT)) <= MOST_LINES
    plan = Rehearsal("salt.yaml").plan()
    assert plan.approach is not None
    assert plan.clearance.surroundings.distance > 5e-3 and plan.clearance.itself.distance > 5e-3
    robot = plan.arm.assembly.robot
    assert robot.velocity.tolist() == [3.1, 2.6, 3.1, 3.1, 3.1, 4.2] and robot.torque[3:].tolist() == [20, 20, 12]
    assert robot.upper[[0, 3]] == pytest.approx([3.1, 6.2831853]) and robot.base == "base_link"


@pytest.mark.slow
def test_it_ends_with_every_bound_held(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At the first run. What is printed are the lines of the page, with numbers of this machine."""
    assert main(shlex.split(REHEARSE)[1:]) == 0
    words = [re.sub(r"-?[\d.]+(e-?\d+)?", "#", text).split() for text in (capsys.readouterr().out, PRINTED)]
    assert words[0] == words[1] and "outside its bound: none\n" in PRINTED
    figures = json.loads(Path("out/salt/report.json").read_text())
    assert figures["missed"] == [] and figures["plan_time_s"] < MOST_PLAN_TIME and figures["wrist_load_ratio_max"] < 1
    assert Path("out/salt/joint_trajectory.yaml").is_file()
