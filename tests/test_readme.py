"""The README's snippets, as a user would run them: each by itself, in a process of its own."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

SNIPPETS = re.findall(r"^```python\n(.*?)^```", (Path(__file__).parents[1] / "README.md").read_text(), re.M | re.S)
SCENE = """
<mujoco>
  <worldbody>
    <body name="box" pos="0.03 0.06 0.05"><freejoint/><geom type="box" size="0.01 0.01 0.01" mass="0.02"/></body>
    <body name="paddle" pos="0.08 0.06 0.05"><joint type="hinge" axis="0 1 0"/>
      <geom type="box" size="0.004 0.02 0.02" mass="0.02"/></body>
  </worldbody>
</mujoco>
"""
"""With the bodies that the snippet on scenes of one's own names."""


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SNIPPETS)))
def test_snippets_run_as_they_stand(tmp_path: Path, number: int) -> None:
    """Without a warning too, and what they print is something."""
    (tmp_path / "scene.xml").write_text(SCENE)
    done = subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", SNIPPETS[number]], cwd=tmp_path, text=True,
                          capture_output=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip() and "nan" not in done.stdout


def test_every_kind_of_snippet_is_found() -> None:
    assert len(SNIPPETS) == 4
    for name, text in zip(("SpoonPour", "rollout", "GranularPlugin", "Shell"), SNIPPETS):
        assert name in text
