"""Settings `key=value`: applied before a configuration is checked, and named in its errors."""

import pytest
from bundled import rehearsal

from robosim.base.errors import ConfigError
from robosim.config.settings import Setting, read_setting, with_settings
from robosim.tasks.task import load_task


@pytest.mark.parametrize(("text", "value"), [("a=1", 1), ("a=0.005", 0.005), ("a=3e-4", 3e-4), ("a=-1E3", -1000.0),
                                             ("a=null", None), ("a=true", True), ("a=salt", "salt"), ("a=x=y", "x=y"),
                                             ("a=[1, 2]", [1, 2]), ("a={b: 1}", {"b": 1}), ("a='1'", "1")])
def test_values_are_yaml(text: str, value: object) -> None:
    assert read_setting(text) == Setting(("a",), value)
    assert read_setting(read_setting(text).text) == Setting(("a",), value)


@pytest.mark.parametrize("text", ["a", "=1", "a..b=1", ".a=1", "a=[1"])
def test_what_is_no_setting_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--set "):
        read_setting(text)


def test_settings_reach_tables_and_lists_and_leave_the_rest() -> None:
    table = {"field": {"cell": 1, "dt": 2}, "waypoints": [{"speed": 1}, {"speed": 2}], "pile": None}
    changed = with_settings(table, map(read_setting, (
        "field.cell=0.5", "waypoints.1.speed=3", "pile.half=[1, 1, 1]", "new=1")))
    assert changed == {"field": {"cell": 0.5, "dt": 2}, "waypoints": [{"speed": 1}, {"speed": 3}],
                       "pile": {"half": [1, 1, 1]}, "new": 1}
    assert table["field"] == {"cell": 1, "dt": 2}  # a copy


def test_a_configuration_has_the_values_that_were_set() -> None:
    changed = rehearsal("spoon", "field.cell=0.0035", "waypoints.2.speed=0.1", "grasp=friction")
    own = rehearsal("spoon")
    assert (changed.field.cell, changed.waypoints[2].speed, changed.grasp) == (0.0035, 0.1, "friction")
    assert changed.waypoints[1] == own.waypoints[1] and own.field.cell != 0.0035
    assert load_task("SpoonPour", [read_setting("grains.count=100")]).grains.count == 100


@pytest.mark.parametrize(("text", "message"), [
    ("feld.cell=1", "--set feld.cell: unknown key 'feld'; valid: .*, field,"),
    ("field.sell=1", "--set field.sell: unknown key 'field.sell'; valid: cell, .*mean 'cell'"),
    ("waypoints.2.sped=1", "--set waypoints.2.sped: unknown key 'waypoints.2.sped'; valid: name, .*mean 'speed'"),
    ("waypoints.2.speed=-1", r"--set waypoints.2.speed: Input should be greater than or equal to 0.0001 \(given: -1\)"),
    ("waypoints.40.speed=1", "--set waypoints.40.speed: waypoints is a list, '40' is no place in it; accepted: 0 to"),
    ("waypoints.lifted.speed=1", "waypoints is a list, 'lifted' is no place in it; accepted: 0 to"),
    ("host_dt.x=1", "--set host_dt.x: host_dt is 0.001, neither a table nor a list; accepted: --set host_dt=VALUE"),
    ("containers.source.color=1", "unknown key 'containers.source.color'; valid: position, yaw_deg, tilt_deg,"),
    ("host_dt=0.01", r"host_dt.*0\.002.*given: 0\.01"),
    ("waypoints.2.frame=bowl", "'bowl'; valid: world, source, target"),
    ("weigh_at=raised", r"spoon.yaml --set weigh_at: weigh_at: unknown waypoint 'raised'; valid: .*lifted")])
def test_errors_name_the_setting_and_what_is_valid(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        rehearsal("spoon", text)


