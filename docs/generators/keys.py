"""The reference of configuration keys, from the schemas."""

from generators.markdown import code, table
from policies.learning.presets import Preset
from robosim.commands.description import keys_of
from robosim.commands.keys import KINDS, import_name

FOLDERS = {"rehearsal": "configs/rehearsals", "task": "configs/tasks",
           "dosing": "configs/dosing", "training": "configs/training", "arm": "models/robots",
           "gripper": "models/grippers", "tool": "models/tools", "measurements": "",
           **{kind: "" for kind in KINDS if kind.startswith("experiment.")}}
"""Where the bundled files of a kind are; empty where there are none."""


def section(kind: str, schema: dict) -> str:
    """One kind of file: its keys with what they accept, their default and their meaning."""
    rows = [[code(key), takes, code(default) if default != "required" else default, meaning]
            for key, takes, default, meaning in keys_of(schema, schema)]
    place = FOLDERS.get(kind, "configs/materials")
    text = schema.get("description", "").split("\n\n")[0] + (f" Bundled files: `{place}/`." if place else "")
    return f"## {kind}\n\n{text}\n\n{table(['key', 'accepts', 'default', 'meaning'], rows)}"


def training_schema() -> dict:
    """The schema of a method; the arguments of a learner's class are free."""
    schema = Preset.model_json_schema()
    free = {name for name, field in schema["properties"].items() if field.get("additionalProperties") is True}
    for name in free:
        schema["properties"][name] = {**schema["properties"][name], "type": "string", "enum": ["table"]}
        del schema["properties"][name]["additionalProperties"]
    return schema


def page() -> str:
    """All kinds of configuration files."""
    kinds = {**{name: import_name(place).model_json_schema() for name, place in KINDS.items()},
             "training": training_schema()}
    return "\n".join(section(name, schema) for name, schema in kinds.items())
