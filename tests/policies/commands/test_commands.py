"""The commands of learning name what they accept, and hand their options on."""

import inspect
from pathlib import Path

import pytest

from robosim.base.resources import config_names
from robosim.commands.main import main, parser
from robosim.tasks.task import load_task


@pytest.mark.parametrize("name", ["demo", "export", "gradients", "rollouts", "train"])
def test_help_lists_the_bundled_tasks(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert ", ".join(config_names("tasks")) in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("arguments", "place"), [
    (["demo", "SpoonPour", "--out", "x"], "policies.demonstrations.demo:demonstrate"),
    (["rollouts", "SpoonPour", "--out", "x"], "policies.dynamics.rollouts:make_rollouts"),
    (["export", "SpoonPour", "--demos", "x", "--out", "y.hdf5"], "policies.demonstrations.export:export"),
    (["gradients", "SpoonPour", "--out", "x"], "policies.demonstrations.gradients:gradients"),
    (["train", "sac", "SpoonPour", "--out", "x"], "policies.methods.train:train"),
    (["sweep", "small.yaml"], "policies.runs.sweep:sweep"),
    (["tables", "runs", "--out", "x"], "policies.results.tables:tables"),
], ids=lambda value: value if isinstance(value, str) else value[0])
def test_options_are_handed_on_as_the_function_takes_them(arguments: list[str], place: str, monkeypatch) -> None:
    """With the defaults of the command line where those of the function are the same."""
    module, _, name = place.partition(":")
    function = getattr(__import__(module, fromlist=[name]), name)
    calls = []

    def record(*args: object, **options: object) -> int:
        calls.append(inspect.signature(function).bind(*args, **options).arguments)
        return 0

    monkeypatch.setattr(f"{module}.{name}", record)
    options = parser().parse_args(arguments)
    assert options.run(options) == 0
    for key, value in calls[0].items():
        default = inspect.signature(function).parameters[key].default
        if default is not inspect.Parameter.empty and key not in ("jobs", "change", "page"):
            assert value == default, key


@pytest.mark.parametrize("name", ["set", "set.hdf5"])
def test_an_exported_dataset_keeps_the_task_with_the_settings(name: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("policies.demonstrations.export.export", lambda task, *_, **__: load_task(task).grains.count)
    (tmp_path / "notes.txt").touch()
    words = ["export", "SpoonPour", "--demos", "x", "--out", str(tmp_path / name), "--set", "grains.count=100"]
    assert main(words) == load_task(str(tmp_path / "set" / "SpoonPour.yaml")).grains.count == 100
