"""Files of methods: errors."""

import pytest

from policies.learning.presets import Preset, load_preset
from robosim.base.errors import ConfigError


def test_an_error_in_a_file_names_the_key(tmp_path):
    """In one line, with the keys that exist."""
    file = tmp_path / "mine.yaml"
    file.write_text("description: mine\nlearner: SAC\nepisods: 3\n")
    with pytest.raises(ConfigError, match="unknown key 'episods'; valid: description, .*episodes") as error:
        load_preset(str(file))
    assert "pydantic" not in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("method", ["ppo", "bc", "gail", "residual", "dagger", "demo"])
def test_settings_without_effect_are_refused(method):
    wrong = {**load_preset(method).model_dump(), "demonstrations": {"size": 50, "fraction": 0.5, "updates": 1}}
    with pytest.raises(ValueError, match="accepted: with SAC"):
        Preset(**wrong)
