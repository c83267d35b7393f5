"""`robosim keys`: what may stand in a rehearsal's, a task's, a robot's or a material's file."""

import json
from typing import Any

from robosim.config.materials import KINDS as LAWS
from robosim.config.output import aligned
from robosim.config.schema import RehearsalConfig, RobotConfig, Table
from robosim.errors import UnknownName
from robosim.tasks.task import TaskConfig

KINDS: dict[str, type[Table]] = {"rehearsal": RehearsalConfig, "task": TaskConfig, "robot": RobotConfig,
                                 **{f"material.{law}": kind for law, kind in LAWS.items()}}
WORDS = {"string": "text", "number": "number", "integer": "whole number", "boolean": "true | false", "null": "null"}
BOUNDS = {"minimum": "from {}", "exclusiveMinimum": "above {}", "maximum": "up to {}", "exclusiveMaximum": "below {}"}


def keys(kind: str, *, schema: bool = False) -> int:
    """Print the keys of a kind of file with type, default and meaning, or its JSON Schema, which editors complete and
    check by; returns 0. Raises UnknownName for a kind that does not exist."""
    if kind not in KINDS:
        raise UnknownName("kind", kind, KINDS)
    described = KINDS[kind].model_json_schema()
    if schema:
        print(json.dumps(described, indent=2))
        return 0
    rows = [list(row) for row in below(described, described, "")]
    print(described["description"], aligned([["key", "takes", "default", "meaning"], *rows]), sep="\n\n")
    return 0


def below(table: dict[str, Any], top: dict[str, Any], prefix: str) -> list[tuple[str, str, str, str]]:
    """(key, what it takes, default, meaning) of everything in a table of a schema, tables in it by dotted keys."""
    rows = []
    for name, field in table["properties"].items():
        told = json.dumps(field["default"]) if "default" in field else "required"
        inner = tables(field, top)
        meaning = field.get("description") or " ".join(one.get("description", "") for _, one in inner)
        rows.append((prefix + name, what(field), told, meaning.replace("\n", " ")))
        for mark, one in inner:
            rows += below(one, top, f"{prefix}{name}{mark}.")
    return rows


def tables(field: dict[str, Any], top: dict[str, Any], mark: str = "") -> list[tuple[str, dict[str, Any]]]:
    """Tables that a key may hold, with what follows the key where these are several."""
    if "$ref" in field:
        return [(mark, referred(field, top))]
    if isinstance(field.get("items"), dict):
        return tables(field["items"], top, f"{mark}[]")
    if isinstance(field.get("additionalProperties"), dict):
        return tables(field["additionalProperties"], top, f"{mark}.NAME")
    return [found for one in field.get("anyOf", ()) for found in tables(one, top, mark)]


def referred(field: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """What a reference within a schema stands for."""
    return top["$defs"][field["$ref"].rsplit("/", 1)[1]]


def what(field: dict[str, Any]) -> str:
    """What a key takes, in words."""
    if "$ref" in field:
        return "table"
    if "anyOf" in field:
        return " | ".join(map(what, field["anyOf"]))
    if "enum" in field or "const" in field:
        return " | ".join(str(one) for one in field.get("enum", [field.get("const")]))
    if field.get("type") == "array":
        inner = field.get("items") or (field.get("prefixItems") or [{}])[0]
        least, most = field.get("minItems", 0), field.get("maxItems")
        count = f" of {least}" if least == most else f" of {least} or more" if least else ""
        return f"list{count}: {what(inner)}"
    if field.get("type") == "object":
        return f"table of NAME: {what(field['additionalProperties'])}"
    bounds = [words.format(f"{field[key]:g}") for key, words in BOUNDS.items() if key in field]
    return " ".join([WORDS[field["type"]], *bounds])
