"""Wrong input: the message names what was given, where, and what would be accepted, before any work."""

import subprocess
import sys
from pathlib import Path

import pytest
from bundled import plan_of, rehearsal

from robosim.base.errors import ConfigError, UnreachableWaypoint
from robosim.base.files import write_status
from robosim.base.output_folder import OutputFolder
from robosim.base.resources import config_names, config_path
from robosim.commands.main import main
from robosim.config.materials import load_material, overridden
from robosim.config.rehearsal import load_rehearsal
from robosim.config.settings import read_setting
from robosim.planning.plan import plan_motion
from robosim.planning.waypoint_path import WaypointPath
from robosim.scene.field import check_field


@pytest.mark.parametrize("name", config_names("materials"))
def test_materials_are_complete(name: str) -> None:
    material = load_material(name)
    for number in material.numbers():
        assert len(getattr(material, number).source) > 10


@pytest.mark.parametrize(("key", "default", "other"), [("tension", True, False), ("volume_rate", "particle", "cell")])
def test_keys_of_a_fluid_reach_its_law(key: str, default: object, other: object, tmp_path: Path) -> None:
    """And what a state says of its material; another word is refused with file and key."""
    path = tmp_path / "splash.yaml"
    text = config_path("materials", "water", "material").read_text()
    for line, expected in (("", default), (f"{key}: {other}\n", other)):
        path.write_text(text + line)
        material = load_material(str(path))
        assert getattr(material.make_law(), key) == material.values().get(key, expected) == expected
    path.write_text(text + f"{key}: sometimes\n")
    with pytest.raises(ConfigError, match=rf"splash\.yaml: .*{key}"):
        load_material(str(path))


@pytest.mark.parametrize(("setting", "message"), [
    ("waypoints.2.speed=1e-9", r"--set waypoints.2.speed: .* greater than or equal to 0.0001 \(given: 1e-09\)"),
    ("field.region_upper=[1e6, 1, 1]", "--set field.region_upper: field.region_upper.0: .* less than or equal to 10"),
    ("field.region_upper=[10, 10, 10]", "field: region_lower .* grid nodes; accepted: up to 1e[+]08"),
    ("servo.stiffness=[1, 1, 1, 1, 1, 1, .inf]", "--set servo.stiffness: servo.stiffness.6: .* finite number"),
    ("servo={damping: [1, 1, 1, 1, 1, 1, 1], bandwidth: 9}", "damping with bandwidth; accepted: stiffness with"),
    ("waypoints.2.position=[620, 0, 0]", r"position.0: .* to 10 \(given: 620\); it is in metres; .* 620 mm, 0.62\?$"),
    ("containers.source.position=[-60, 0, 0]", r"to -10 \(given: -60\); it is in metres; .* -60 mm, -0.06\?$"),
    ("field.cell=-1", r"\(given: -1\); it is in metres$"),
    ("tool=spon", "--set tool: unknown tool 'spon'; valid: bottle, .*; did you mean 'spoon'[?]$"),
    ("robot={model: a.urdf, flange: b, limits: {velocty: 1}}", "'robot.limits.velocty'; .* you mean 'velocity'[?]$"),
    (f"description={'x' * 3000}", "--set description: .* at most 2000 characters"),
    ("recorded=[a, b, c" + ", d" * 200 + "]", "--set recorded: .* at most 200 items"),
    ("tool={name: a, mesh: a.stl, mass: -1, handle: {head: [0, 0, 0], end: [0, 0, 1]}}",
     r"^--set tool: tool.mass: .* to 0.001 \(given: -1\)$"),
    ("robot={model: a.urdf, flange: b, limits: {velocity: fast}}", "^--set robot: robot.limits.velocity: [^;]*'fast'"),
    ("robot={model: a.urdf, flang: b}", "robot.flange: Field required; --set robot: unknown key 'robot.flang'; valid"),
])
def test_extreme_numbers_are_refused_by_name(setting: str, message: str) -> None:
    """Before any work, with the bound that is accepted; tests/test_extreme_inputs.py has every key of every file."""
    with pytest.raises(ConfigError, match=message) as error:
        rehearsal("spoon", setting)
    assert len(str(error.value)) < 1500


def test_products_are_bounded_before_any_work() -> None:
    """Grains of a cell by cells, and substeps of a stiff material by steps."""
    fine = rehearsal("spoon", "field.cell=0.0006", "tool_wall=0.0006", "field.grains_per_cell=64",
                     "field.region_lower=[0.6,-0.35,0]", "field.region_upper=[0.84,0.35,0.1]")
    stiff = overridden(load_material("salt"), {"E": 1e12, "density": 1.0})
    for config, material, message in (
            (fine, load_material("salt"), "field.grains_per_cell = 64.0 with field.cell = 0.0006 m: .* grains in the "
                                          "container 'source'; accepted: up to 4"),
            (rehearsal("spoon"), stiff, "host_dt = 0.001 s takes .* substeps of .*; accepted: up to 10000")):
        with pytest.raises(ConfigError, match=message):
            check_field(config, material.make_law())
    with pytest.raises(ConfigError, match="E: value = 1e[+]300; accepted: 100 to 1e[+]12"):
        overridden(load_material("salt"), {"E": 1e300})


def test_a_path_that_takes_hours_names_its_slowest_leg() -> None:
    config = rehearsal("spoon", "waypoints.7.speed=1e-4")
    with pytest.raises(ConfigError, match=r"the path takes .* steps of host_dt = 0.001 s: the leg to waypoint 'across' "
                                          r"alone takes .*\(its speed = 0.0001 m/s\); accepted: up to 300 s in all"):
        WaypointPath(config)


def test_a_key_that_is_given_twice_is_refused(tmp_path: Path) -> None:
    """YAML's last one would win, without a word."""
    path = tmp_path / "mine.yaml"
    path.write_text(config_path("rehearsals", "spoon", "rehearsal").read_text() + "host_dt: 0.0005\n")
    with pytest.raises(ConfigError, match=r"mine.yaml: cannot be read as YAML: line \d+: key 'host_dt' is given twice"):
        load_rehearsal(str(path))
    with pytest.raises(ConfigError, match=r"--set field=.*: key 'cell' is given twice"):
        read_setting("field={cell: 1, cell: 2}")


def test_many_errors_are_counted() -> None:
    with pytest.raises(ConfigError, match=r"and 59\d more$"):
        rehearsal("spoon", waypoints=[{"speed": -1}] * 150)


def test_unreachable_waypoint_says_how_far() -> None:
    with pytest.raises(UnreachableWaypoint, match="'across'.*mm beyond the arm's reach") as error:
        plan_motion(rehearsal("spoon", "waypoints.7.frame=world", "waypoints.7.position=[1.6, 0.0, 0.4]",
                              grip_turn_deg=0.0))
    assert error.value.position_error > 0.05


@pytest.mark.long
def test_a_speed_that_joints_cannot_follow_is_refused() -> None:
    """At any turn of the tool in the hand; it is slowed down where the file allows that."""
    tilt = [w.name for w in rehearsal("spoon").waypoints].index("tilt")
    setting = f"waypoints.{tilt}.angular_speed=2.6"
    plan = plan_motion(rehearsal("spoon", setting))
    assert 1.0 < plan.time_scale < 3.0 and plan.path.duration > plan_of("spoon").path.duration
    with pytest.raises(ConfigError, match=r"joint A\d would need"):
        plan_motion(rehearsal("spoon", setting, max_time_scale=1.0, grip_turn_deg=0.0))


def test_output_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert main(["rehearse", "spoon", "--out", str(blocked / "out")]) == 2
    assert "--out" in capsys.readouterr().err


def test_a_folder_belongs_to_one_process_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Until it has ended, however it ended; the same process comes back as it likes."""
    words = (f"import sys, pathlib; from robosim.base.output_folder import OutputFolder; "
             f"folder = OutputFolder(pathlib.Path({str(tmp_path)!r})); print(1, flush=True); sys.stdin.read()")
    with subprocess.Popen([sys.executable, "-c", words], text=True,
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None and other.stdout.readline() == "1\n"
        assert main(["rehearse", "spoon", "--out", str(tmp_path)]) == 2
        assert f"--out {tmp_path}: another process is at work there" in capsys.readouterr().err
        other.kill()
    first = OutputFolder(tmp_path)
    OutputFolder(tmp_path).write_json("report.json", {})
    first.clear(("report.json",))


def test_a_folder_of_other_files_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with OutputFolder(tmp_path, is_shared=True) as shared:  # as of a motion that is exported into it
        shared.write_text("notes.txt", "mine")
    for words in (["rehearse", "spoon"], ["train", "sac", "Pendulum-v1"], ["report", "free_fall", "--quick"]):
        assert main([*words, "--out", str(tmp_path)]) == 2
        assert f"--out {tmp_path}: holds other files, such as notes.txt; accepted: a new or empty folder, or one of " \
               "an earlier run" in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    write_status(tmp_path, "failed")
    OutputFolder(tmp_path).release()
