"""Keys of configuration files: their description, and templates that list them."""

import json
import textwrap
from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml

from robosim.config.table import Table

WORDS = {"string": "text", "number": "number", "integer": "whole number", "boolean": "true | false", "null": "null"}
BOUNDS = {"minimum": "from {}", "exclusiveMinimum": "above {}", "maximum": "up to {}", "exclusiveMaximum": "below {}",
          "maxLength": "up to {} characters"}
Schema = dict[str, Any]
WIDTH = 110
"""Longest line of a comment."""


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
    bounds = [words.format(f"{field[key]:g}") for key, words in BOUNDS.items() if key in field]
    if "$ref" in field:
        return " ".join(["table, value", *bounds]) if bounds else "table"
    if "anyOf" in field:
        return " | ".join(map(accepted, field["anyOf"]))
    if "enum" in field or "const" in field:
        return " | ".join(str(one) for one in field.get("enum", [field.get("const")]))
    if field.get("type") == "array":
        inner = field.get("items") or (field.get("prefixItems") or [{}])[0]
        least, most = field.get("minItems", 0), field.get("maxItems")
        span = f"{least} to {most}" if least else f"up to {most}"
        count = f" of {least}" if least == most else f" of {span}" if most else f" of {least} or more" if least else ""
        return f"list{count}: {accepted(inner).replace(' | ', ' or ')}"
    if field.get("type") == "object":
        extra = field.get("additionalProperties")
        return f"table of NAME: {accepted(extra)}" if isinstance(extra, dict) else "table with free names"
    if "type" not in field:
        return "any value"
    return " ".join([WORDS[field["type"]], *bounds])


def template(kind: type[Table], basis: dict[str, Any], heading: str) -> str:
    """Write a file with the values of `basis` and a comment for every key of a schema, those without a value too."""
    schema = kind.model_json_schema()
    return "\n".join([*comment(heading), "", *lines_of(schema, schema, basis, "")]) + "\n"


def lines_of(table: Schema, top: Schema, values: dict[str, Any], indent: str) -> Iterator[str]:
    """Write the keys of a table; a key that has no value stands behind a `#` without a space, with its default."""
    for name, field in table["properties"].items():
        yield from explanation("", field, top, indent)
        inner = tables(field, top)
        is_block = [mark for mark, _ in inner] == [""] and values.get(name) and not is_short(values[name])
        if is_block and isinstance(values[name], dict):  # an empty one would be null with its keys as comments
            yield f"{indent}{name}:"
            yield from lines_of(inner[0][1], top, values[name], indent + "  ")
            continue
        for key, entry in (pair for _, one in inner for pair in one["properties"].items()):
            if not is_short(values.get(name)):
                yield from explanation(f"{key}: ", entry, top, indent, "#   ")
        if name in values:
            yield from written(name, values[name], indent)
        else:
            yield f"{indent}#{name}: {flow(field.get('default'))}"


def written(name: str, value: Any, indent: str) -> Iterator[str]:
    """Write a key with its value: lists of tables and tables with free names an entry a line, anything else in one."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        yield f"{indent}{name}:"
        yield from (f"{indent}  - {flow(entry)}" for entry in value)
    elif isinstance(value, dict) and value and all(isinstance(entry, dict) for entry in value.values()):
        yield f"{indent}{name}:"
        yield from (f"{indent}  {key}: {flow(entry)}" for key, entry in value.items())
    else:
        yield f"{indent}{name}: {flow(value)}"


def is_short(value: Any) -> bool:
    """Whether a value is a number with unit and source, which stand in one line."""
    return isinstance(value, dict) and set(value) == {"value", "unit", "source"}


def explanation(key: str, field: Schema, top: Schema, indent: str, mark: str = "# ") -> list[str]:
    """Write what a key means, which values it accepts and its default, in one line or the last two in their own."""
    default = f"default {flow(field['default'])}" if "default" in field else "required"
    text, values = (key + meaning(field, top)).strip(), f"({accepted(field)}; {default})"
    if len(indent + mark + text + values) < WIDTH:
        return comment(f"{text} {values}".strip(), indent, mark)
    return [*comment(text, indent, mark), *comment(values, indent, mark)]


def comment(text: str, indent: str = "", mark: str = "# ") -> list[str]:
    """Write a text as lines of a comment."""
    return textwrap.wrap(text, WIDTH, initial_indent=indent + mark, subsequent_indent=indent + mark)


def flow(value: Any) -> str:
    """Write a value as YAML in one line."""
    return yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10**6).removesuffix("...\n").strip()
