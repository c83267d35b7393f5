"""`robosim keys` lists the keys of files, and `robosim new` writes files that have them."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from robosim.commands.keys import KINDS, import_name
from robosim.commands.main import main
from robosim.commands.new import BASES, bundled_names, find_source
from robosim.config.arm import ArmConfig
from robosim.config.materials import load_material
from robosim.config.rehearsal import load_rehearsal
from robosim.config.table import load
from robosim.tasks.task import load_task


def load_arm_file(name: str) -> ArmConfig:
    """Load the file of an arm, whose model's path is then absolute."""
    return load(find_source("arm", name), ArmConfig)


LOAD = {"rehearsal": load_rehearsal, "task": load_task, "material": load_material, "arm": load_arm_file}
EVERY = [(kind, name) for kind in BASES for name in bundled_names(kind)]


@pytest.mark.parametrize(("kind", "basis"), EVERY)
def test_a_template_is_the_same_configuration_with_every_key(kind: str, basis: str, tmp_path: Path) -> None:
    """Also after every key that is a comment was put in with its default."""
    path = tmp_path / "mine.yaml"
    assert main(["new", kind, str(path), "--from", basis]) == 0
    assert LOAD[kind](str(path)) == LOAD[kind](basis)
    whole = re.sub(r"^( *)#(\w+: )", r"\1\2", path.read_text(), flags=re.MULTILINE)
    path.write_text(whole)
    assert LOAD[kind](str(path)) == LOAD[kind](basis)
    classes = [import_name(place) for name, place in KINDS.items() if name.split(".")[0] == kind]
    assert set(yaml.safe_load(whole)) in [set(schema.model_fields) for schema in classes]


def test_a_bundled_basis_is_the_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    """NAME.yaml in the current folder, whether or not its ending is given; a name of a bundled file is noted."""
    monkeypatch.chdir(tmp_path)
    for kind, basis in BASES.items():
        assert main(["new", kind, f"my_{kind}"]) == 0
        assert LOAD[kind](f"my_{kind}.yaml") == LOAD[kind](basis)
    assert main(["new", "task", "own.yml"]) == 0 and Path("own.yml").is_file()
    capsys.readouterr()
    assert main(["new", "material", "salt"]) == 0
    assert "salt without .yaml still means the bundled material" in capsys.readouterr().out


def test_a_file_is_never_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("mine")
    for name in (path, path.with_suffix("")):
        assert main(["new", "rehearsal", str(name)]) == 2
        assert f"robosim new: {path}: exists already and is left as it is" in capsys.readouterr().err
    assert path.read_text() == "mine"


@pytest.mark.parametrize(("arguments", "message"), [
    (["rehearsal", "lab", "--from", "fork"], "unknown rehearsal 'fork'; valid: bottle, dose_bottle, dose_spoon"),
    (["rehearsal", "nowhere/lab"], "there is no folder nowhere")])
def test_what_cannot_be_made_is_refused(arguments: list[str], message: str, tmp_path: Path,
                                        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", *arguments]) == 2
    assert message in capsys.readouterr().err and not list(tmp_path.iterdir())


BUNDLED = ("rehearsal", "task", "arm")


def leaves(table: Any, prefix: str = "") -> set[str]:
    """Dotted keys of a file, entries of lists as []."""
    if isinstance(table, dict):
        return {found for name, value in table.items() for found in {prefix + name} | leaves(value, f"{prefix}{name}.")}
    if isinstance(table, list):
        return {found for value in table for found in leaves(value, prefix[:-1] + "[].")}
    return set()


@pytest.mark.parametrize("kind", BUNDLED)
def test_every_key_of_a_bundled_file_is_listed(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", kind]) == 0
    table = capsys.readouterr().out.split("\nkey ", 1)[1]  # after the description
    lines = [line.split() for line in table.splitlines()[1:]]
    listed = {line[0] for line in lines}
    assert len(listed) == len(lines)
    for name in bundled_names(kind):
        used = leaves(yaml.safe_load(find_source(kind, name).read_text()))
        # drawn numbers and those of a dosing controller are keys of their own: `robosim keys dosing`
        used = {re.sub(r"^(randomize|dose\.numbers)\.[\w.]+", r"\1", key) for key in used}
        assert {re.sub(r"containers\.\w+", "containers.NAME", key) for key in used} - {"containers.NAME"} <= listed


def test_bounds_defaults_and_meanings_are_those_of_the_schema(capsys: pytest.CaptureFixture[str]) -> None:
    main(["keys", "rehearsal"])
    rows = {line.split()[0]: re.split(r" {2,}", line) for line in capsys.readouterr().out.splitlines()[3:]}
    assert rows["host_dt"][1:] == ["number from 1e-05 up to 0.002", "0.001",
                                   "MuJoCo step [s], and the time by which the grains advance at once."]
    assert rows["waypoints[].angular_speed"][1:3] == ["number from 0.001 up to 100", "1.5"]
    assert rows["limits.jerk"][1] == "list of 5 to 8: number from 0.001 up to 1e+06 | null"
    assert rows["path"][3].startswith("How the tool rounds")
    assert rows["containers.NAME.fill_height"][1:3] == ["number from 0 up to 10", "0.0"]


@pytest.mark.parametrize("kind", KINDS)
def test_schema_is_json_with_every_table(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["keys", kind, "--schema"])
    schema = json.loads(capsys.readouterr().out)
    assert set(schema["properties"]) == set(import_name(KINDS[kind]).model_fields)
    assert all(table["additionalProperties"] is False for table in (schema, *schema.get("$defs", {}).values()))
