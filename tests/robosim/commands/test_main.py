"""The command line: help, version, wrong names, what it does not import, and names that it lists without loading."""

import contextlib
import ctypes
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from importlib.metadata import EntryPoint, version
from pathlib import Path

import pytest
from written_arms import write_urdf

from robosim.base.errors import ConfigError
from robosim.commands import main as module
from robosim.commands.arguments import NUMBERS
from robosim.commands.main import COMMANDS, interrupts, main, parser
from robosim.studies.benchmarks import FIELD_SCENES
from robosim.studies.benchmarks import field as benchmark
from robosim.studies.verification import stability
from robosim.studies.verification.stability import field

EVERY = sorted([*COMMANDS, "demo", "export", "gradients", "pipeline", "rollouts", "sweep", "tables", "train"])
HEAVY = {"taichi", "mujoco", "pinocchio", "torch", "matplotlib", "gymnasium", "numpy", "scipy", "pydantic", "yaml"}
WRONG = {
    "a command": (["fork"], "'fork'.*rehearse"),
    "a rehearsal": (["rehearse", "fork", "--out", "x"], "unknown rehearsal 'fork'; valid: bottle, dose_bottle"),
    "a material": (["chain", "spoon", "--material", "pepper", "--out", "x"], "unknown material 'pepper'; valid: clay"),
    "a camera": (["rehearse", "spoon", "--camera", "left", "--out", "x"], "unknown camera 'left'; valid: auto"),
    "a task": (["evaluate", "SpoonPuor"], "unknown task 'SpoonPuor'; valid: BottlePickPour"),
    "no suite": (["evaluate", "SpoonPour", "--alone"], "--alone without --suite; accepted: with one"),
    "a policy": (["evaluate", "SpoonPour", "--policy", "best"], "unknown policy 'best'; valid: knowing"),
    "a scene": (["explain", "SpoonPuor"], "unknown scene 'SpoonPuor'; valid: .*spoon"),
    "a case": (["report", "vortx", "--out", "x"], "unknown case 'vortx'; valid: .*vortex"),
    "an axis": (["stability", "curant", "--out", "x"], "unknown axis 'curant'; valid: .*courant"),
    "a kind": (["keys", "fork"], "unknown kind 'fork'; valid: .*rehearsal"),
    "a method": (["train", "dgsac", "SpoonPour", "--out", "x"], "unknown method 'dgsac'; valid: bc"),
    "a task to learn": (["train", "sac", "SpoonPuor", "--out", "x"], "unknown task 'SpoonPuor'; valid: Bottle"),
    "a task to show": (["demo", "SpoonPuor", "--out", "x"], "unknown task 'SpoonPuor'; valid: Bottle"),
    "a pipeline": (["pipeline", "ladle", "--out", "x"], "rehearsal 'ladle'; accepted: bottle"),
    "a task of materials": (["materials", "Nothing", "--out", "x"], "unknown task 'Nothing'; valid: Bottle"),
    "a policy of materials": (["materials", "SpoonPour", "--policy", "best", "--out", "x"], "unknown policy 'best'"),
    **{f"no {kind}": ([*words.split(), "--out", "x"], f"{kind} no.yaml: no such file; accepted: {accepted}")
       for kind, words, accepted in (
           ("rehearsal", "rehearse no.yaml", "a .yaml file of your own, or one of bottle"),
           ("task", "demo no.yaml", "a .yaml file of your own, or one of BottlePickPour"),
           ("method", "train no.yaml SpoonPour", "a .yaml file of your own, or one of bc"),
           ("measurements", "calibrate no.yaml", "the path of a .yaml file, see `robosim keys measurements`"))}}


def run(*commands: list[str]) -> list[tuple[int, str, set[str]]]:
    """Run commands in one other process: exit status, stderr, and which heavy modules are loaded after each."""
    code = (f"import contextlib, io, json, sys; from robosim.commands.main import main\n"
            f"for words in {commands!r}:\n"
            f"    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.redirect_stdout(io.StringIO()):\n"
            f"        try: status = main(words)\n"
            f"        except SystemExit as end: status = end.code\n"
            f"    print(json.dumps([status, said.getvalue(), sorted({HEAVY!r} & set(sys.modules))]))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return [(status, error, set(loaded)) for status, error, loaded in map(json.loads, done.stdout.splitlines())]


def test_what_cannot_draw_is_named_in_a_line() -> None:
    words = [sys.executable, "-m", "robosim", "explain", "spoon"]
    done = subprocess.run(words, env={**os.environ, "MUJOCO_GL": "none"}, capture_output=True, text=True)
    assert done.returncode == 2 and re.fullmatch("robosim explain: MUJOCO_GL=none: cannot be loaded .*\n", done.stderr)
    words = [sys.executable, "-c", "import robosim; robosim.Rehearsal"]
    done = subprocess.run(words, env={**os.environ, "MUJOCO_GL": "none"}, capture_output=True, text=True)
    assert re.fullmatch(r".*ConfigError: MUJOCO_GL=none: cannot be loaded .*; accepted: disable, .*",
                        done.stderr.splitlines()[-1]) and "During handling" not in done.stderr


def test_long_paths_and_names_of_other_alphabets(tmp_path: Path) -> None:
    """In a terminal that is older than UTF-8: what cannot be written is refused, what cannot be shown is escaped."""
    write_urdf(tmp_path / "arm.urdf", ('"q0"', '"Ä"'))
    environment = {**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    for words, status, said in ((["new", "arm", "arm.urdf"], 0, r".*at the end of \\xc4, .*"),
                                (["new", "material", "Süß"], 2, r"robosim: 'S.*': not text in the encoding ascii .*"),
                                (["view", 5000 * "x"], 2, r"robosim view: .* too long: 'x{99}\.\.\.x*'")):
        done = subprocess.run([sys.executable, "-m", "robosim", *words], cwd=tmp_path, env=environment,
                              capture_output=True, text=True)
        first, = done.stdout.splitlines()[:1] or done.stderr.splitlines()
        assert done.returncode == status and re.fullmatch(said, first) and len(first) < 400, (first, done.stderr)


def test_help_loads_nothing_heavy() -> None:
    commands = [["--help"], ["--version"], *([name, "--help"] for name in ("rehearse", "train", "demo", "keys"))]
    assert run(*commands) == [(0, "", set())] * len(commands)


def test_a_wrong_name_is_refused_before_anything_heavy_is_loaded() -> None:
    results = run(*(arguments for arguments, _ in WRONG.values()))
    for (what, (arguments, message)), (status, error, loaded) in zip(WRONG.items(), results, strict=True):
        assert (status, loaded) == (2, set()), what
        assert re.match(f"robosim({'' if what == 'a command' else ' ' + arguments[0]}): .*{message}", error), error
        assert error.count("\n") == 1 and not Path("x").exists()


def test_the_parser_has_every_command() -> None:
    """Those of other packages too, from their entry points."""
    with pytest.raises(SystemExit) as end:
        parser().parse_args(["fork"])
    assert end.value.code == 2
    assert sorted(parser()._subparsers._group_actions[0].choices) == EVERY  # type: ignore[union-attr]


@pytest.mark.parametrize("name", EVERY)
def test_help_describes_the_command_with_examples_that_it_accepts(name: str,
                                                                  capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: robosim {name}")
    description, examples = text.split("\n\n")[1], text[text.rindex("\nexample"):]
    assert description.endswith((".", "tasks", "seeds")) and f"  robosim {name} " in examples
    for line in examples.splitlines():
        if line.startswith("  robosim "):
            parser().parse_args(shlex.split(line.split(">")[0])[1:])


def test_python_m_robosim_is_the_command_line() -> None:
    done = subprocess.run([sys.executable, "-m", "robosim", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"robosim {version('robosim')}\n"


def test_a_command_that_cannot_be_loaded_leaves_the_others(monkeypatch: pytest.MonkeyPatch,
                                                           capsys: pytest.CaptureFixture[str]) -> None:
    broken = EntryPoint("fork", "no_such_package.fork:add_parser", module.GROUP)
    monkeypatch.setattr(module, "entry_points", lambda group: [broken])
    assert main(["keys", "arm"]) == 0
    assert "the command fork (no_such_package.fork:add_parser) cannot be loaded" in capsys.readouterr().err


@pytest.mark.parametrize("name", EVERY)
def test_numbers_have_bounds(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """In every command, and before its modules are loaded: an error names the option, the text and what is accepted."""
    command = next(action for action in parser()._actions if action.dest == "command").choices[name]
    options = {option: action.type for action in command._actions for option in action.option_strings
               if action.type not in (None, Path)}
    assert set(options) <= set(NUMBERS)
    before = set(sys.modules)
    for option, number in options.items():
        assert number is NUMBERS[option] and number.least < number.most < float("inf")
        for text in ("nan", "inf", "1e308", "-1", "9" * 5000, "0x10", "", "ten", *(["0.5"] if number.is_whole else [])):
            with pytest.raises(SystemExit) as end:
                main([name, f"{option}={text}"])
            words = capsys.readouterr().err
            assert end.value.code == 2 and len(words) < 300
            assert words.startswith(f"robosim {name}: argument {option}: '{text[:40]}"), words
            assert f"number from {number.least:.10g} to {number.most:.10g}; see" in words, words
        for bound in (number.least, number.most):
            assert number(f"{bound!r}") == bound
    assert set(sys.modules) == before


def test_an_interrupt_that_was_discarded_is_raised_again(monkeypatch: pytest.MonkeyPatch,
                                                         capfd: pytest.CaptureFixture[str]) -> None:
    """As by compiled code while a library is imported, of which nothing is printed; one that is being handled is left
    alone."""
    monkeypatch.setattr("robosim.commands.main.REPEAT", 0.05)
    steps = []
    with interrupts() as received, pytest.raises(KeyboardInterrupt, match="SIGTERM"):
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGTERM) or time.sleep(60))()
        steps.append("discarded")
        try:
            time.sleep(60)
        finally:
            try:
                time.sleep(0.12)
                raise OSError
            except OSError:
                time.sleep(0.105)  # ends midway between two alarms
            steps.append("handled")
    assert steps == ["discarded", "handled"] and received == [signal.SIGTERM] and capfd.readouterr().err == ""
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_second_signal_does_not_cut_off_what_the_first_one_ends() -> None:
    """A child has SIGTERM from its group and from its parent."""
    with interrupts() as received, pytest.raises(KeyboardInterrupt):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            received.append(0)
    assert received == [signal.SIGTERM, 0]


def test_an_error_that_an_interrupt_causes_is_called_one(monkeypatch: pytest.MonkeyPatch,
                                                         capsys: pytest.CaptureFixture) -> None:
    """As of a module whose import was cut off; the same error without an interrupt is raised."""
    def fail(arguments: list[str], is_interrupted: bool = True) -> int:
        if is_interrupted:
            with contextlib.suppress(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGTERM)
        raise NameError("name '_ndimage_api' is not defined")

    monkeypatch.setattr(module, "run_command", fail)
    assert main([]) == 143
    assert capsys.readouterr().err == "robosim: stopped by SIGTERM (NameError: name '_ndimage_api' is not defined)\n"
    monkeypatch.setattr(module, "run_command", lambda arguments: fail(arguments, is_interrupted=False))
    with pytest.raises(NameError):
        main([])


def test_axes_of_the_stability_matrix() -> None:
    assert tuple(field.AXES) == stability.AXES and tuple(field.COMPARISONS) == stability.COMPARISONS
    assert tuple(field.SLEEPING) == stability.SLEEPING_AXES


def test_a_scene_that_could_not_be_measured_is_an_exit_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(scene: str, *_: object) -> dict[str, float]:
        if scene == "fluid":
            raise ConfigError("no such processor")
        return {"ns": 100.0}

    monkeypatch.setattr(benchmark, "_in_fresh_process", measure)
    words = ["bench", "field", "--sizes", "300", "--out", str(tmp_path), "--scenes"]
    assert main([*words, "sand"]) == 0
    assert main([*words, *FIELD_SCENES]) == 1
