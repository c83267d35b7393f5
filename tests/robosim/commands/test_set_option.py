"""`--set KEY=VALUE` of the commands."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from bundled import read_bundled
from filelock import FileLock

from robosim.commands.arguments import Settings
from robosim.commands.main import main, parser
from robosim.config.settings import read_setting
from robosim.tasks.task import load_task

COMMANDS = ("rehearse spoon", "chain spoon", "evaluate SpoonPour", "explain SpoonPour", "explain spoon",
            "materials SpoonPour", "demo SpoonPour", "rollouts SpoonPour", "pipeline spoon", "gradients SpoonPour")
HEAVY = {"trimesh", "taichi", "mujoco", "pinocchio", "torch", "gymnasium", "matplotlib"}


def test_a_wrong_key_is_refused_before_what_only_the_work_needs_is_loaded(tmp_path: Path) -> None:
    """So that the message comes at once: no mesh, robot, physics or learning library, and no folder is made."""
    code = (f"import sys; from robosim.commands.main import main\n"
            f"for words in {COMMANDS}:\n"
            f"    assert main([*words.split(), '--out', sys.argv[1], '--set', 'field.sell=1']) == 2\n"
            f"print(*{HEAVY} & {{*sys.modules}})")
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "out")], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "\n"), done.stderr
    for words, line in zip(COMMANDS, done.stderr.splitlines(), strict=True):
        assert line.startswith(f"robosim {words.split()[0]}: --set field.sell: unknown key 'field.sell'; valid: cell, ")
    assert not (tmp_path / "out").exists()


def test_presets_and_sweeps_are_changed_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["train", "sac", "SpoonPour", "--out", str(tmp_path / "out"), "--set"]
    for setting, message in (("learnr=PPO", "unknown key 'learnr'; valid: description, learner"),
                             ("actor.rat=1", "unknown key 'actor.rat'; valid: waits, rate"),
                             ("actor.rate=0", "actor.rate: Input should be greater than or equal to 0.000001")):
        assert main([*words, setting]) == 2
        assert message in capsys.readouterr().err
    file = tmp_path / "sweep.yaml"
    file.write_text(f"tasks: [SpoonPour]\nmethods: [sac]\nseeds: [0]\nout: {tmp_path / 'runs'}\n")
    assert main(["sweep", str(file), "--dry-run", "--set", "seeds=[3, 4]"]) == 0
    assert "2 runs, 0 finished" in capsys.readouterr().out


def test_settings_make_a_file_of_its_own_in_the_folder(tmp_path: Path) -> None:
    """The bundled one stays, a file in the folder itself is not replaced, and without settings nothing is written."""
    with Settings().changed("tasks", "SpoonPour", tmp_path) as task:
        assert task == "SpoonPour" and not list(tmp_path.iterdir())
    changes = Settings((read_setting("grains.count=100"),))
    with changes.changed("tasks", "SpoonPour", tmp_path) as task:
        assert Path(task) == tmp_path / "SpoonPour.yaml" and load_task(task).grains.count == 100
        with FileLock(tmp_path / ".lock").acquire(timeout=0):  # as commands of other packages lock their folder
            pass
    assert yaml.safe_load((tmp_path / "SpoonPour.yaml").read_text()) == read_bundled("tasks", "SpoonPour") | {
        "grains": {"count": 100}}
    before = (tmp_path / "SpoonPour.yaml").read_text()
    assert main(["evaluate", str(tmp_path / "SpoonPour.yaml"), "--set", "steps=10", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "SpoonPour.yaml").read_text() == before
    assert main(["rehearse", "spoon", "--set", "robot=WRONG", "--out", str(tmp_path / "new")]) == 2
    assert not (tmp_path / "new").exists()
    with changes.changed("tasks", "SpoonPour", None) as task:
        temporary = Path(task)
        assert temporary.is_file()
    assert not temporary.exists()


def test_what_is_no_setting_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        parser().parse_args(["evaluate", "SpoonPour", "--set", "steps"])
    assert end.value.code == 2
    assert "robosim evaluate: --set steps; accepted: KEY=VALUE" in capsys.readouterr().err


@pytest.mark.long
def test_an_evaluation_with_settings_is_of_the_changed_task(tmp_path: Path) -> None:
    words = ["evaluate", "SpoonPour", "--policy", "zero", "--nominal", "--no-video", "--out", str(tmp_path)]
    assert main([*words, "--set", "steps=20", "--set", "material=sugar"]) == 0
    stored = json.loads((tmp_path / "evaluation.json").read_text())
    assert stored["task"] == str(tmp_path / "SpoonPour.yaml")
    assert load_task(stored["task"]).material == "sugar"
