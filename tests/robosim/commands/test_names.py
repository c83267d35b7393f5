"""Names that the help lists without loading what they name are those that exist."""

from pathlib import Path

import pytest

from robosim.base.errors import ConfigError
from robosim.commands.main import main
from robosim.studies.benchmarks import FIELD_SCENES
from robosim.studies.benchmarks import field as benchmark
from robosim.studies.verification import stability
from robosim.studies.verification.stability import field


def test_axes_of_the_stability_matrix() -> None:
    assert tuple(field.AXES) == stability.AXES and tuple(field.COMPARISONS) == stability.COMPARISONS
    assert tuple(field.SLEEPING) == stability.SLEEPING_AXES


def test_a_scene_that_could_not_be_measured_is_an_exit_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(scene: str, *_: object) -> dict[str, float]:
        if scene == "fluid":
            raise ConfigError("no such processor")
        return {"ns": 100.0}

    monkeypatch.setattr(benchmark, "_in_fresh_process", measure)
    words = ["bench", "field", "--sizes", "300", "--out", str(tmp_path), "--scenes"]
    assert main([*words, "sand"]) == 0
    assert main([*words, *FIELD_SCENES]) == 1
