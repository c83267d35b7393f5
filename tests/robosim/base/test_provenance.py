"""The digest of the code that a result depends on."""

from pathlib import Path

import pytest

from robosim.base import provenance
from robosim.base.provenance import code_digest, source_files


def test_the_digest_changes_with_imported_code_only(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With what a module imports, directly or not, and with nothing else."""
    for name, text in {"__init__": "", "case": "import mpm.a", "a": "from mpm import b", "b": "", "c": ""}.items():
        (tmp_path / "mpm").mkdir(exist_ok=True)
        (tmp_path / "mpm" / f"{name}.py").write_text(text)
    monkeypatch.setattr(provenance, "ROOT", tmp_path)

    def digest_after_change(changed: str) -> str:
        with (tmp_path / "mpm" / f"{changed}.py").open("a") as file:
            file.write("\n")
        code_digest.cache_clear()
        return code_digest("mpm.case")

    digests = [digest_after_change(name) for name in ("c", "c", "b", "case")]
    code_digest.cache_clear()
    assert digests[0] == digests[1] and len(set(digests)) == 3


@pytest.mark.parametrize("module", ["robosim.studies.benchmarks.scene_run",
                                    "robosim.studies.evaluation.material_episode",
                                    "robosim.studies.verification.cases.robot.arm_limits"])
def test_the_digest_covers_the_shapes_of_tools(module: str) -> None:
    assert {"vessels.py", "sheet_tools.py", "tool.py"} <= {path.name for path in source_files(module)}
