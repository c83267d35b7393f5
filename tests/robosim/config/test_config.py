"""Wrong input: the message names what was given, where, and what would be accepted, before any work."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import mpm
from robosim.base.errors import ConfigError, UnknownName, UnreachableWaypoint
from robosim.base.output_folder import OutputFolder
from robosim.base.resources import config_names, config_path
from robosim.commands.main import main
from robosim.config.materials import load_material, overridden
from robosim.config.rehearsal import load_rehearsal
from robosim.config.settings import read_setting
from robosim.planning.plan import plan_motion
from robosim.planning.waypoint_path import WaypointPath
from robosim.scene.field import check_field


@pytest.fixture
def spoon() -> dict:
    return yaml.safe_load(config_path("rehearsals", "spoon", "rehearsal").read_text())


def written(tmp_path: Path, data: dict) -> str:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


@pytest.mark.parametrize("name", config_names("materials"))
def test_materials_are_complete(name: str) -> None:
    material = load_material(name)
    for number in material.numbers():
        assert len(getattr(material, number).source) > 10


def test_a_fluid_may_be_without_tension(tmp_path: Path) -> None:
    """The key reaches the law, and what a state says of its material; a word is refused with file and key."""
    path = tmp_path / "splash.yaml"
    text = config_path("materials", "water", "material").read_text()
    for line, expected in (("", True), ("tension: false\n", False)):
        path.write_text(text + line)
        material = load_material(str(path))
        law = material.make_law()
        assert isinstance(law, mpm.NewtonianFluid)
        assert law.tension is expected
        assert material.values()["tension"] is expected
    path.write_text(text + "tension: sometimes\n")
    with pytest.raises(ConfigError, match=r"splash\.yaml: .*tension"):
        load_material(str(path))


def test_a_fluid_may_follow_the_rate_of_its_cell(tmp_path: Path) -> None:
    """The key reaches the law; another word is refused with file and key."""
    path = tmp_path / "swing.yaml"
    text = config_path("materials", "water", "material").read_text()
    for line, expected in (("", "particle"), ("volume_rate: cell\n", "cell")):
        path.write_text(text + line)
        law = load_material(str(path)).make_law()
        assert isinstance(law, mpm.NewtonianFluid)
        assert law.volume_rate == expected
    path.write_text(text + "volume_rate: node\n")
    with pytest.raises(ConfigError, match=r"swing\.yaml: .*volume_rate"):
        load_material(str(path))


def test_unknown_rehearsal_material_and_camera(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = str(tmp_path / "out")
    for arguments, words in (
        (["rehearse", "fork", "--out", out], ("'fork'", "spoon")),
        (["rehearse", "spoon", "--material", "pepper", "--out", out], ("'pepper'", "salt", "flour")),
        (["rehearse", "spoon", "--camera", "left", "--out", out], ("'left'", "overview", "close", "wrist")),
    ):
        assert main(arguments) == 2
        message = capsys.readouterr().err
        assert all(word in message for word in words), message
        assert not (tmp_path / "out").exists()


def test_unknown_key_lists_the_valid_ones(tmp_path: Path, spoon: dict) -> None:
    spoon["field"]["sell"] = 0.004
    with pytest.raises(ConfigError, match=r"'field.sell'; valid: .*cell") as error:
        load_rehearsal(written(tmp_path, spoon))
    assert "mine.yaml" in str(error.value)


def test_wrong_value_is_named_with_its_place(tmp_path: Path, spoon: dict) -> None:
    spoon["host_dt"] = 0.01
    with pytest.raises(ConfigError, match=r"host_dt.*0\.001.*given: 0\.01"):
        load_rehearsal(written(tmp_path, spoon))


@pytest.mark.parametrize(("setting", "message"), [
    ("waypoints.2.speed=1e-9", r"--set waypoints.2.speed: .* greater than or equal to 0.0001 \(given: 1e-09\)"),
    ("waypoints.6.dwell=1e7", "--set waypoints.6.dwell: .* less than or equal to 600"),
    ("field.grains_per_cell=1e6", "--set field.grains_per_cell: .* less than or equal to 64"),
    ("field.region_upper=[1e6, 1, 1]", "--set field.region_upper: field.region_upper.0: .* less than or equal to 100"),
    ("field.region_upper=[90, 90, 90]", "field: region_lower .* grid nodes; accepted: up to 1e[+]08"),
    ("field.cell=1e-300", "--set field.cell: .* greater than or equal to 0.0001"),
    ("host_dt=1e-9", "--set host_dt: .* greater than or equal to 0.00001"),
    ("field.tool_friction=1e300", "--set field.tool_friction: .* less than or equal to 10"),
    ("servo.stiffness=[1, 1, 1, 1, 1, 1, .inf]", "--set servo.stiffness: servo.stiffness.6: .* finite number"),
    ("limits.jerk=[1e99, 1, 1, 1, 1, 1, 1]", "--set limits.jerk: limits.jerk.0: .* less than or equal to 1000000"),
    (f"description={'x' * 3000}", "--set description: .* at most 2000 characters"),
    ("learned=[a, b, c" + ", d" * 200 + "]", "--set learned: .* at most 200 items"),
])
def test_extreme_numbers_are_refused_by_name(setting: str, message: str) -> None:
    """Before any work, with the bound that is accepted."""
    with pytest.raises(ConfigError, match=message) as error:
        load_rehearsal("spoon", settings=[read_setting(setting)])
    assert len(str(error.value)) < 1500


@pytest.mark.parametrize(("settings", "message"), [
    (["field.cell=0.0006", "tool_wall=0.0006", "field.grains_per_cell=64", "field.region_lower=[0.6,-0.35,0]",
      "field.region_upper=[0.84,0.35,0.1]"],
     "field.grains_per_cell = 64.0 with field.cell = 0.0006 m: .* grains in the container 'source'; accepted: up to 4"),
])
def test_products_are_bounded_before_any_work(settings: list[str], message: str) -> None:
    config = load_rehearsal("spoon", settings=[read_setting(text) for text in settings])
    with pytest.raises(ConfigError, match=message):
        check_field(config, load_material("salt").make_law())


def test_a_stiff_material_takes_too_many_substeps() -> None:
    stiff = overridden(load_material("salt"), {"E": 1e12, "density": 1.0})
    with pytest.raises(ConfigError, match="host_dt = 0.001 s takes .* substeps of .*; accepted: up to 10000"):
        check_field(load_rehearsal("spoon"), stiff.make_law())
    with pytest.raises(ConfigError, match="E: value = 1e[+]300; accepted: 100 to 1e[+]12"):
        overridden(load_material("salt"), {"E": 1e300})


def test_a_path_that_takes_hours_names_its_slowest_leg() -> None:
    config = load_rehearsal("spoon", settings=[read_setting("waypoints.7.speed=1e-4")])
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


def test_many_errors_are_counted(tmp_path: Path, spoon: dict) -> None:
    spoon["waypoints"] = [{"speed": -1}] * 150
    with pytest.raises(ConfigError, match=r"and 59\d more$"):
        load_rehearsal(written(tmp_path, spoon))


def test_unknown_frame_and_waypoint(tmp_path: Path, spoon: dict) -> None:
    spoon["waypoints"][2]["frame"] = "bowl"
    with pytest.raises(ConfigError, match="'bowl'; valid: world, source, target"):
        load_rehearsal(written(tmp_path, spoon))
    spoon["waypoints"][2]["frame"] = "source"
    spoon["weigh_at"] = "raised"
    with pytest.raises(ConfigError, match="'raised'; valid: .*lifted"):
        load_rehearsal(written(tmp_path, spoon))


def test_unreachable_waypoint_says_how_far(tmp_path: Path, spoon: dict) -> None:
    far = next(w for w in spoon["waypoints"] if w["name"] == "across")
    far.update(frame="world", position=[1.6, 0.0, 0.4])
    with pytest.raises(UnreachableWaypoint, match="'across'.*mm beyond the arm's reach") as error:
        plan_motion(load_rehearsal(written(tmp_path, spoon)))
    assert error.value.position_error > 0.05


def test_a_speed_that_joints_cannot_follow_is_refused(tmp_path: Path, spoon: dict) -> None:
    """At any turn of the tool in the hand; it is slowed down where the file allows that."""
    next(w for w in spoon["waypoints"] if w["name"] == "tilt")["angular_speed"] = 2.6
    plan = plan_motion(load_rehearsal(written(tmp_path, spoon)))
    assert 1.0 < plan.time_scale < 3.0 and plan.path.duration > plan_motion(load_rehearsal("spoon")).path.duration
    spoon |= {"max_time_scale": 1.0, "grip_turn_deg": 0.0}
    with pytest.raises(ConfigError, match=r"joint A\d would need"):
        plan_motion(load_rehearsal(written(tmp_path, spoon)))


def test_time_step_above_the_bound_gives_both_numbers() -> None:
    body = mpm.Body(mpm.Elastic(E=1e6, nu=0.3, density=1000.0), mpm.sample_box((0, 0, 0), (0.1, 0.1, 0.1), 0.02),
                    volume=8e-6)
    with pytest.raises(mpm.TimeStepTooLarge) as error:
        mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body], dt=1e-2)
    assert "0.01 s" in str(error.value) and f"{error.value.bound:.4g} s" in str(error.value)


def test_bound_is_the_isolated_particles() -> None:
    """3-D, nu = 0.3: Courant number 0.734 of the bulk wave (validation section 0.3)."""
    material = mpm.Elastic(E=1e5, nu=0.3, density=1500.0)
    body = mpm.Body(material, mpm.sample_box((0, 0, 0), (0.1, 0.1, 0.1), 0.02), volume=8e-6)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body])
    wave = ((material.lam + 2 * material.mu) / 1500.0) ** 0.5
    assert solver.bound * wave / 0.02 == pytest.approx(0.734, abs=5e-4)


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


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    folder = OutputFolder(tmp_path)
    folder.write_json("report.json", {"a": 1})

    def full(path: Path) -> None:
        path.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        folder.write("report.json", full)
    assert (tmp_path / "report.json").read_text() == '{\n  "a": 1\n}\n'
    assert sorted(p.name for p in tmp_path.iterdir()) == [".lock", "report.json"]


def test_full_disk_ends_with_a_message(tmp_path: Path, capsys: pytest.CaptureFixture,
                                       monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("robosim.base.output_folder.write_text", full)
    assert main(["rehearse", "spoon", "--out", str(tmp_path / "out")]) == 1
    assert "No space left on device" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_said_to(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["rehearse", str(tmp_path / "nothere.yaml"), "--out", str(tmp_path / "out")]) == 2
    assert "nothere.yaml: no such file; accepted: a .yaml file of your own, or one of bottle" in capsys.readouterr().err


def test_unknown_names_list_the_valid_ones() -> None:
    with pytest.raises(UnknownName, match="valid: clay, flour, glass_beads, glycerol, paper, salt, sand, sugar, water"):
        load_material("pepper")
    with pytest.raises(mpm.UnknownName, match="valid: f32, f64"):
        mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), 0.1), bodies=[], precision="f16")
