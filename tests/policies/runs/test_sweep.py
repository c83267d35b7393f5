"""Sweeps: planning, running, SLURM."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

import mpm
from policies.learning.presets import load_preset
from policies.runs.sweep import sweep
from policies.runs.sweep_file import SweepFile, load_sweep, plan_runs
from robosim.base.errors import ConfigError
from robosim.base.jobs import read_last_line
from robosim.base.resources import folder
from robosim.config.table import read, validate

PUBLISHED = folder("configs") / "published"


def test_unknown_tasks_are_refused_before_any_run(tmp_path):
    whole = {"methods": ["sac"], "seeds": [0], "out": tmp_path}
    for task in ("SpoonPuor", "shovel"):
        with pytest.raises(ConfigError, match=f"unknown task '{task}'; valid: BottlePickPour, .*Pendulum-v1"):
            plan_runs(SweepFile(tasks=["SpoonPour", task], **whole))
    assert len(plan_runs(SweepFile(tasks=["SpoonPour", "Pendulum-v1"], **whole))) == 2


def test_inputs_of_a_method_are_passed_on(tmp_path):
    """Demonstrations and rollouts, to the methods that need them; without them the sweep is refused."""
    settings = {"tasks": ["SpoonPour"], "methods": ["dg_sac", "sac", "gnn_cmaes"], "seeds": [0], "out": tmp_path}
    runs = plan_runs(SweepFile(**settings, demos="demos/{task}", rollouts="rollouts/{task}"))
    inputs = [run.arguments[7:] for run in runs]
    assert inputs == [["--demos", "demos/SpoonPour"], [], ["--rollouts", "rollouts/SpoonPour"]]
    with pytest.raises(mpm.InvalidValue, match="method gnn_cmaes learns from rollouts; give their folder"):
        plan_runs(SweepFile(**settings, demos="demos"))


def write_finished(folder: Path, arguments: str, **changes) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "status.json").write_text('{"state": "finished"}')
    (folder / "manifest.json").write_text(json.dumps({"preset": {**load_preset("sac").model_dump(), **changes},
                                                      "command": f"robosim {arguments}"}))


def test_a_run_with_other_options_is_another(tmp_path):
    """A run that finished with other arguments, such as another material, is another run."""
    def state(*options: str) -> str:
        return plan_runs(SweepFile(tasks=["SpoonPour"], methods=["sac"], seeds=[0], options=list(options),
                                   out=tmp_path))[0].state

    folder = tmp_path / "SpoonPour" / "sac" / "seed_0"
    arguments = f"train sac SpoonPour --seed 0 --out {folder}"
    assert state() == "new"
    write_finished(folder, arguments)
    assert state() == "finished" and state("--material", "sugar") == "another"
    write_finished(folder, f"{arguments} --obs moments", obs="moments")
    assert state("--obs", "moments") == "finished" and state() == "another"


def test_unfinished_runs_are_given_to_a_launcher(tmp_path, capsys):
    """It gets the table and a command for each; a run has failed that says so, or leaves no finished folder."""
    file, given = tmp_path / "small.yaml", {}
    file.write_text(f"tasks: [Pendulum-v1]\nmethods: [sac]\nseeds: [0, 1, 2, 3]\nout: {tmp_path / 'runs'}\n"
                    "launch: {partition: long, hours: 2}\n")
    runs = plan_runs(load_sweep(file))

    def launch(commands, folder):
        given.update(commands=commands, folder=folder)
        write_finished(runs[0].out, " ".join(runs[0].arguments))
        yield SimpleNamespace(index=0, reason="")
        yield SimpleNamespace(index=2, reason="")
        yield SimpleNamespace(index=1, reason="exit status 2 | no such demonstration")

    write_finished(runs[1].out, " ".join(runs[1].arguments))
    launcher = SimpleNamespace(configure=lambda table: given.update(table=table), run=launch)
    assert sweep(file, launcher=launcher) == 1
    assert given["table"] == {"partition": "long", "hours": 2} and given["folder"] == tmp_path / "runs" / "launch"
    assert given["commands"] == [(["robosim", *run.arguments], run.out / "log.txt")
                                 for run in (runs[0], runs[2], runs[3])]
    failed = capsys.readouterr().err
    assert f"failed: {runs[2].out}: exit status 2 | no such demonstration" in failed
    assert f"failed: {runs[3].out}: ended, but {runs[3].out} is new" in failed
    assert json.loads((tmp_path / "runs" / "sweep.json").read_text())["runs"][str(runs[0].out)] == "finished"


def test_the_last_line_of_a_log_is_read_from_its_end(tmp_path: Path) -> None:
    """Of a log of gigabytes, too, whose bytes need not be text."""
    log = tmp_path / "log.txt"
    for content, line in ((b"", ""), (b" \n\n", ""), (b"one\ntwo\n \n", "two"), (b"\xff\xfe", "\ufffd\ufffd")):
        log.write_bytes(content)
        assert read_last_line(log) == line
    with log.open("wb") as file:
        file.truncate(2**34)
        file.seek(2**34)
        file.write(b"\nstopped\n")
    assert read_last_line(log) == "stopped"


def test_entries_differ_in_any_option_each_in_a_folder_of_its_own(tmp_path):
    entries = [{"name": "parts", "method": "dg_sac_literal", "set": {"encoder": "parts"}},
               {"name": "slow", "method": "dg_sac", "set": {"options.learning_rate": 3e-4}, "demos": "ten/{task}"},
               "dg_sac"]
    runs = plan_runs(SweepFile(tasks=["SpoonPour"], methods=entries, seeds=[0], demos="one/{task}", out=tmp_path))
    assert [run.out.relative_to(tmp_path).as_posix() for run in runs] == [
        f"SpoonPour/{name}/seed_0" for name in ("parts", "slow", "dg_sac")]
    assert [run.arguments[7:] for run in runs] == [
        ["--demos", "one/SpoonPour", "--set", 'encoder="parts"', "--label", "parts"],
        ["--demos", "ten/SpoonPour", "--set", "options.learning_rate=0.0003", "--label", "slow"],
        ["--demos", "one/SpoonPour"]]
    assert [run.preset["encoder"] for run in runs] == ["parts", None, None]
    assert runs[1].preset["options"] == {**runs[2].preset["options"], "learning_rate": 3e-4}


def test_entries_with_tasks_and_seeds_of_their_own(tmp_path: Path) -> None:
    """Every seed of the sweep comes before those that entries add; tasks are among the sweep's."""
    whole = {"tasks": ["SpoonPour", "ShovelMove"], "seeds": [0, 1], "out": tmp_path}
    few = {"name": "few", "method": "ppo", "tasks": ["ShovelMove"], "seeds": [2, 0]}
    runs = plan_runs(SweepFile(methods=["sac", few], **whole))
    assert [run.out.relative_to(tmp_path).as_posix() for run in runs] == [
        "SpoonPour/sac/seed_0", "ShovelMove/sac/seed_0", "ShovelMove/few/seed_0",
        "SpoonPour/sac/seed_1", "ShovelMove/sac/seed_1", "ShovelMove/few/seed_2"]
    with pytest.raises(ConfigError, match=r"methods\[1\].tasks: SpoonScoop; accepted: .* SpoonPour, ShovelMove"):
        validate({**whole, "out": str(tmp_path), "methods": ["sac", {**few, "tasks": ["SpoonScoop", "SpoonPour"]}]},
                 tmp_path / "x.yaml", SweepFile)


def test_the_queue_of_the_paper_has_a_run_for_every_published_cell() -> None:
    """What each run needs is bundled, but for the rollouts, which are made before."""
    published = read(PUBLISHED / "arxiv_2406_09178.yaml")
    runs = plan_runs(load_sweep(PUBLISHED / "tables.yaml"))
    planned = {(run.out.parent.name, run.arguments[2]) for run in runs}
    cells = {(method, task) for method, values in published["tcs"].items()
             for task, value in zip(published["tasks"], values) if value is not None}
    assert len(cells) == 9 * 8 + 4 * 8 + 3 and cells <= planned
    for run in runs:
        if "--demos" in run.arguments:
            assert (PUBLISHED.parents[1] / run.arguments[run.arguments.index("--demos") + 1]).exists()


def test_entries_that_do_not_fit_are_refused_by_name(tmp_path):
    whole = {"tasks": ["SpoonPour"], "seeds": [0], "demos": "one", "out": tmp_path}
    twice = [{"name": "dg_sac", "method": "sac", "set": {"options.tau": 0.01}}, "dg_sac"]
    with pytest.raises(mpm.InvalidValue, match="share the folder .*seed_0: '.*tau=0.01.*' and '.*train dg_sac"):
        plan_runs(SweepFile(methods=twice, **whole))
    for change, message in (({"encodr": "parts"}, "encodr"), ({"learner.name": "SAC"}, "learner is 'SAC'")):
        with pytest.raises(ConfigError, match=message):
            plan_runs(SweepFile(methods=[{"name": "x", "method": "dg_sac", "set": change}], **whole))
