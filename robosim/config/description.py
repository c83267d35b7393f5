"""Description of a configuration's keys, read from the JSON Schema of its tables."""

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

WORDS = {"string": "text", "number": "number", "integer": "whole number", "boolean": "true | false", "null": "null"}
BOUNDS = {"minimum": "from {}", "exclusiveMinimum": "above {}", "maximum": "up to {}", "exclusiveMaximum": "below {}"}
Schema = dict[str, Any]


class Key(NamedTuple):
    """A key of a file."""

    name: str
    """Dotted, with [] for the entries of a list and NAME for those of a table with free names."""
    accepts: str
    default: str
    """As JSON; "required" where there is none."""
    meaning: str


def keys_of(table: Schema, top: Schema, prefix: str = "") -> Iterator[Key]:
    """List the keys of a table of the schema `top`, those of tables in it after their own."""
    for name, field in table["properties"].items():
        default = json.dumps(field["default"]) if "default" in field else "required"
        yield Key(prefix + name, accepted(field), default, meaning(field, top))
        for mark, inner in tables(field, top):
            yield from keys_of(inner, top, f"{prefix}{name}{mark}.")


def meaning(field: Schema, top: Schema) -> str:
    """Give the description of a key, or of the tables that it holds."""
    text = field.get("description") or " ".join(inner.get("description", "") for _, inner in tables(field, top))
    return text.replace("\n", " ")


def tables(field: Schema, top: Schema, mark: str = "") -> list[tuple[str, Schema]]:
    """List the tables that a key may hold, each with what follows the key: [] in a list, .NAME under free names."""
    if "$ref" in field:
        return [(mark, top["$defs"][field["$ref"].rsplit("/", 1)[1]])]
    if isinstance(field.get("items"), dict):
        return tables(field["items"], top, f"{mark}[]")
    if isinstance(field.get("additionalProperties"), dict):
        return tables(field["additionalProperties"], top, f"{mark}.NAME")
    return [table for one in field.get("anyOf", ()) for table in tables(one, top, mark)]


def accepted(field: Schema) -> str:
    """Describe the values that a key accepts: type, bounds and choices."""
    if "$ref" in field:
        return "table"
    if "anyOf" in field:
        return " | ".join(map(accepted, field["anyOf"]))
    if "enum" in field or "const" in field:
        return " | ".join(str(one) for one in field.get("enum", [field.get("const")]))
    if field.get("type") == "array":
        inner = field.get("items") or (field.get("prefixItems") or [{}])[0]
        least, most = field.get("minItems", 0), field.get("maxItems")
        count = f" of {least}" if least == most else f" of {least} or more" if least else ""
        return f"list{count}: {accepted(inner)}"
    if field.get("type") == "object":
        extra = field.get("additionalProperties")
        return f"table of NAME: {accepted(extra)}" if isinstance(extra, dict) else "table with free names"
    if "type" not in field:
        return "any value"
    bounds = [words.format(f"{field[key]:g}") for key, words in BOUNDS.items() if key in field]
    return " ".join([WORDS[field["type"]], *bounds])
