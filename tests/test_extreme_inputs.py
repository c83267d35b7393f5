"""Extreme values in configurations: only the project's own errors, within 2 GB and 10 s for each input."""

import itertools
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from extreme_values import MEMORY, WILD, changed_tables, damaged, fuzz, handle, look_up, places, replaced
from hypothesis import strategies as st

from policies.learning.presets import Preset, load_preset
from policies.runs.sweep_file import SweepFile, load_sweep, plan_runs
from robosim.base.resources import folder
from robosim.commands.keys import KINDS, import_name
from robosim.config.arm import ArmConfig
from robosim.config.materials import load_material
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.config.settings import read_setting, with_settings
from robosim.config.table import load, validate
from robosim.planning.waypoint_path import WaypointPath
from robosim.robot.robot import load_arm
from robosim.scene.field import check_field, check_substeps, choose_substep
from robosim.scene.grains import grain_volume
from robosim.tasks.task import TaskConfig, is_task, load_task

CONFIGS, ARM = folder("configs"), folder("models") / "robots" / "iiwa14" / "arm.yaml"
SWEEP = {"tasks": ["SpoonPour"], "methods": ["dg_sac", "sac"], "seeds": [0, 1], "demos": "out/{task}", "rollouts": None,
         "episodes": 5, "options": ["--obs", "moments"], "out": "out/runs"}
SCHEMAS: dict[str, Any] = {**{name: import_name(place) for name, place in KINDS.items()}, "training": Preset,
                           "sweep": SweepFile}
FEW_AND_MANY = [12, pytest.param(1000, marks=pytest.mark.slow)]
"""Examples of a fuzz test."""


def table(path: str) -> dict[str, Any]:
    return yaml.safe_load((CONFIGS / path).read_text())


def full(path: str, kind: type) -> dict[str, Any]:
    """The same with every key that it may have, as its configuration holds it."""
    return kind.model_validate(table(path)).model_dump(mode="json")


class File(NamedTuple):
    read: Callable[[str], Any]
    """Its reader, given the path."""
    kind: Any
    """Its schema."""
    values: dict[str, Any]
    """A table that is accepted."""


FILES = {
    "rehearsal": File(load_rehearsal, RehearsalConfig, full("rehearsals/spoon.yaml", RehearsalConfig)),
    "pile": File(load_rehearsal, RehearsalConfig, full("rehearsals/shovel.yaml", RehearsalConfig)),
    "task": File(load_task, TaskConfig, full("tasks/SpoonScoop.yaml", TaskConfig)),
    "move": File(load_task, TaskConfig, full("tasks/ShovelMove.yaml", TaskConfig)),
    "arm": File(load_arm, ArmConfig, load(ARM, ArmConfig).model_dump(mode="json")),
    "granular": File(load_material, SCHEMAS["material.granular"], table("materials/salt.yaml")),
    "mu_i": File(load_material, SCHEMAS["material.mu_i"], table("materials/glass_beads.yaml")),
    "fluid": File(load_material, SCHEMAS["material.fluid"], table("materials/water.yaml")),
    "clay": File(load_material, SCHEMAS["material.clay"], table("materials/clay.yaml")),
    "learner": File(load_preset, Preset, full("training/residual.yaml", Preset)),
    "graph": File(load_preset, Preset, full("training/gnn_cmaes.yaml", Preset)),
    "sweep": File(lambda path: plan_runs(load_sweep(Path(path))), SweepFile, SWEEP),
}


def use(config: Any) -> None:
    """What an accepted configuration is checked for before it takes memory or time."""
    salt = load_material("salt").make_law()
    if isinstance(config, RehearsalConfig):
        check_field(config, salt)
        assert WaypointPath(config).duration / config.host_dt < 1e6
    if isinstance(config, TaskConfig):
        check_substeps("step_dt", config.step_dt, choose_substep(config, salt))
        grain_volume(config)
        config.scripted_path().pose(0.1)
    if isinstance(config, SweepFile):
        plan_runs(config)


def check(values: dict[str, Any], kind: Any) -> Any:
    """Validate a table as its reader does after it has read the file."""
    return validate(values, Path("x.yaml"), kind)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_number_text_and_list_of_a_schema_has_bounds(kind: str) -> None:
    """What a schema leaves open is checked elsewhere: the value of a quantity by its name, tables with free names."""
    schema = SCHEMAS[kind].model_json_schema()
    parts = {".".join(map(str, place)): look_up(schema, place) for place in places(schema)}
    parts = {place: part for place, part in parts.items()
             if isinstance(part, dict) and isinstance(part.get("type"), str)}
    assert len(parts) > 5
    for place, part in parts.items():
        if place.endswith("Quantity.properties.value") or part.get("format") == "path" or {"enum", "const"} & set(part):
            continue
        wanted = {"number": ("inimum", "aximum"), "integer": ("inimum", "aximum"), "string": ("maxLength",),
                  "array": ("maxItems",)}.get(part["type"], ())
        for word in wanted:
            assert any(word in key for key in part), f"{kind}: {place}: {part} has no bound {word}"


@pytest.mark.parametrize("name", FILES)
def test_every_number_is_refused_where_it_is_not_finite(name: str) -> None:
    """And where it is beyond every bound; the message has the key."""
    _, kind, values = FILES[name]
    numbers = [place for place in places(values) if isinstance(look_up(values, place), float | int)]
    assert numbers
    for place in numbers:
        for wild in (float("nan"), 1e300, -1e300, 10**400) if not isinstance(look_up(values, place), bool) else ():
            changed = replaced(values, place, wild)
            config, message = handle(lambda changed=changed: check(changed, kind))
            assert config is None and str(place[0]) in message, (place, wild)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_every_key_refuses_or_bears_every_wild_value(name: str) -> None:
    _, kind, values = FILES[name]
    for place, wild in itertools.product(places(values), WILD):
        changed = replaced(values, place, wild)
        config, _ = handle(lambda changed=changed: check(changed, kind))
        if config is not None:
            handle(lambda config=config: use(config))


@pytest.mark.parametrize("examples", FEW_AND_MANY)
@pytest.mark.parametrize("name", FILES)
def test_changed_tables_are_refused_or_borne(name: str, examples: int) -> None:
    _, kind, values = FILES[name]
    assert handle(lambda: use(check(values, kind))) == (None, "")
    fuzz(changed_tables(values), examples, lambda changed: use(check(changed, kind)))


@pytest.mark.parametrize("examples", [5, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["task", "arm", "granular", "learner", "sweep"])
def test_damaged_files_are_refused_or_borne(name: str, examples: int, tmp_path: Path) -> None:
    """The rest of a kind's readers is that of tables."""
    path, values = tmp_path / "mine.yaml", FILES[name].values
    content = yaml.safe_dump({key: values[key] for key in list(values)[:12]}).encode()
    for read in (FILES[name].read, is_task):
        fuzz(damaged(content), examples, lambda changed, read=read: (path.write_bytes(changed), read(str(path))))


@pytest.mark.parametrize("examples", [50, pytest.param(5000, marks=pytest.mark.slow)])
def test_settings_are_refused_or_borne(examples: int) -> None:
    """The texts of `--set`."""
    values = FILES["task"].values
    keys = st.sampled_from([".".join(map(str, place)) for place in places(values)])
    fuzz(st.one_of(st.text(max_size=50), st.builds("{}={}".format, keys, st.text(max_size=50))), examples,
         lambda text: check(with_settings(values, [read_setting(text)]), TaskConfig))


COMMANDS = [
    "rehearse spoon --out out --set waypoints.2.speed=1e-9", "rehearse spoon --out out --set waypoints.6.dwell=1e7",
    "rehearse spoon --out out --set field.grains_per_cell=1e6",
    "rehearse spoon --out out --set field.region_upper=[1e6,1e6,1e6]",
    "rehearse spoon --out out --set field.region_upper=[90,90,90]", "evaluate SpoonPour --set steps=1000000000",
    "evaluate SpoonPour --seed 9999999999", "evaluate SpoonPour --policy lying.npz",
    "evaluate SpoonPour --policy large.npz", "materials SpoonPour --policy lying.npz --out out",
    "explain SpoonPour --set grains.count=1000000000", "rollouts SpoonPour --jobs 1000000 --out out",
    "bench field --sizes 1000000000000", "tables deep.json --out out", "rehearse deep.yaml --out out",
    "sweep deep.yaml", "report vortex --quick --points deep.json --out out", "train deep.yaml SpoonPour --out out",
    "new task mine --from deep.yaml"]
CHILD = f"""
import pathlib, re, sys
from extreme_values import bounded
from robosim.commands.main import main
for line in sys.stdin.read().splitlines():
    with bounded():
        try:
            status = main(line.split())
        except SystemExit as end:
            status = end.code
    print(status, file=sys.stderr)
# The peak of this program: getrusage's ru_maxrss begins at the size of the process that started it.
peak = int(re.search(r"VmHWM:\\s+(\\d+) kB", pathlib.Path("/proc/self/status").read_text())[1])
assert peak < {MEMORY // 1024}, f"{{peak}} kB"
"""


def test_commands_refuse_extreme_inputs_before_work(tmp_path: Path) -> None:
    """A line each on stderr, exit status 2, within 2 GB and 10 s: 32 GB are promised, or 128 MB packed in 128 kB."""
    actions = b"\x93NUMPY\x01\x00\x76\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (%s, 6), }"
    for name, count, size in (("lying", b"1333333333", 2400), ("large", b"5592405", 24 * 5592405)):
        with zipfile.ZipFile(tmp_path / f"{name}.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("actions.npy", (actions % count).ljust(127) + b"\n" + bytes(size))
    for name in ("deep.json", "deep.yaml"):
        (tmp_path / name).write_text("[" * 100_000)
    done = subprocess.run([sys.executable, "-c", CHILD], input="\n".join(COMMANDS), cwd=tmp_path, capture_output=True,
                          text=True, env={"PYTHONPATH": ":".join(sys.path), "HOME": str(tmp_path)})
    lines = done.stderr.splitlines()
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert lines[1::2] == ["2"] * len(COMMANDS), done.stderr
    for command, message in zip(COMMANDS, lines[::2], strict=True):
        assert message.startswith(f"robosim {command.split()[0]}: "), message
    assert not list(tmp_path.glob("out/*")), "work was begun"
