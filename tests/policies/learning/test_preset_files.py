"""Files of methods: errors, and presets of earlier versions."""

import pytest

import mpm
from policies.learning.preset_files import load_preset, migrate_manifest, migrate_preset
from policies.learning.presets import Preset


def test_an_error_in_a_file_names_the_key(tmp_path):
    """In one line, with the keys that exist."""
    file = tmp_path / "mine.yaml"
    file.write_text("description: mine\nlearner: SAC\nepisods: 3\n")
    with pytest.raises(mpm.InvalidValue, match="unknown key 'episods'; accepted: description, .*episodes") as error:
        load_preset(str(file))
    assert "pydantic" not in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("method", ["ppo", "bc", "gail", "residual", "cmaes", "demo"])
def test_settings_without_effect_are_refused(method):
    """Fractions of batches without demonstrations. Presets that earlier versions stored with them are migrated."""
    right = load_preset(method).model_dump()
    wrong = {**right, "demonstrations": {"size": 50, "fraction": 0.5, "updates": 1}}
    with pytest.raises(ValueError, match="accepted: with SAC"):
        Preset(**wrong)
    assert migrate_preset(wrong) == right


def test_a_manifest_of_an_earlier_version_is_migrated():
    """`hold` is action_repeat now; what did not exist has its default."""
    preset = load_preset("sac").model_dump()
    stored = {"method": "sac", "preset": {key: value for key, value in preset.items() if key != "graph"}, "hold": 10}
    assert migrate_manifest(stored) == {"method": "sac", "preset": preset, "action_repeat": 10, "n_envs": 1}
