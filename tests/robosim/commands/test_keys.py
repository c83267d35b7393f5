"""`robosim keys` lists the keys of the bundled files, and its schema accepts what the code accepts."""

import json
import re
from typing import Any

import pytest
import yaml

from robosim.commands.keys import KINDS, import_name
from robosim.commands.main import main
from robosim.commands.new import bundled_names, find_source

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
    assert rows["host_dt"][1:] == ["number from 1e-05 up to 0.001", "0.001", "MuJoCo step [s]."]
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
