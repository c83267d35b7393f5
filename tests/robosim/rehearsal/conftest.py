"""A rehearsal that tests share."""

from pathlib import Path

import pytest
import yaml

from robosim.base.resources import config_path


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """A rehearsal of three waypoints with cells of 10 mm, which exercises all parts in little time."""
    data = yaml.safe_load(config_path("rehearsals", "spoon", "rehearsal").read_text())
    by_name = {w["name"]: w for w in data["waypoints"]}
    for name in ("start", "home"):
        by_name[name]["position"][2] = 0.12
    dip = by_name["above"] | {"name": "dip", "position": [-0.03, 0, 0.06], "speed": 0.3, "stop": True, "dwell": 0.2}
    data["waypoints"] = [by_name["start"], dip, by_name["home"]]
    data.update(weigh_at="dip", tool_wall=0.005, grasp_time=0.2)
    data["field"] |= {"cell": 0.01, "grains_per_cell": 4}
    path = tmp_path / "short.yaml"
    path.write_text(yaml.safe_dump(data))
    return path
