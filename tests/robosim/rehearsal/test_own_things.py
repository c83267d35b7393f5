"""A laboratory's own ladle and bowls, from a folder with a few lines of YAML."""

import re
from pathlib import Path

import pytest
from own_meshes import write_bowl, write_ladle

from robosim.config.rehearsal import load_rehearsal
from robosim.scene.build import compile_rehearsal
from robosim.scene.field import choose_region

TUTORIAL = Path(__file__).parents[3] / "docs" / "tutorials" / "own_ladle.md"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the two meshes and the tutorial's rehearsal."""
    write_ladle(tmp_path / "ladle.stl")
    write_bowl(tmp_path / "bowl.stl")
    (block,) = re.findall(r"```yaml\n(description.*?)```", TUTORIAL.read_text(), re.S)
    (tmp_path / "salt.yaml").write_text(block)
    return tmp_path


def test_paths_are_relative_to_the_file_and_the_scene_has_the_own_things(folder: Path) -> None:
    config = choose_region(load_rehearsal(str(folder / "salt.yaml")))
    assert config.sources == ("full",) and config.sinks == ("empty",) and config.tool_name == "ladle"
    low, high = config.field.region_lower, config.field.region_upper
    assert low is not None and high is not None and low[0] < 0.47 and high[1] > 0.35 and high[2] > 0.3
    scene = compile_rehearsal(config)
    bodies = {scene.model.body(k).name for k in range(scene.model.nbody)}
    assert {"ladle", "full", "empty", "hand_clamp"} <= bodies
    assert scene.model.body("ladle").mass[0] == pytest.approx(0.12)


def test_a_tool_may_have_a_file_of_its_own(folder: Path) -> None:
    """With paths relative to that file."""
    (folder / "tools").mkdir()
    write_ladle(folder / "tools" / "ladle.stl")
    text = (folder / "salt.yaml").read_text()
    table = text[text.index("  name: ladle") : text.index("containers:")]
    (folder / "tools" / "ladle.yaml").write_text(re.sub("^  ", "", table, flags=re.M))
    (folder / "salt.yaml").write_text(text.replace("tool:\n" + table, "tool: tools/ladle.yaml\n"))
    config = load_rehearsal(str(folder / "salt.yaml"))
    assert config.tool_name == "ladle" and not isinstance(config.tool, str)
    assert Path(config.tool.mesh) == folder / "tools" / "ladle.stl"
