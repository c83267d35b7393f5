"""Comparison of two records."""

import fnmatch
import json
from pathlib import Path
from typing import Any

SHOWN = 12
"""Values of a case that are printed at most."""


def compare(a: Path, b: Path, patterns: list[str]) -> int:
    """Print what differs in two records, and what one lacks; returns 1 if there is anything."""
    one, other = (json.loads(path.read_text()) for path in (a, b))
    for key in ("code", "versions", "machine"):
        if one[key] != other[key]:
            print(f"{key}: {one[key]} | {other[key]}")
    names = [name for name in {**one["cases"], **other["cases"]} if any(fnmatch.fnmatchcase(name, p) for p in patterns)]
    same, lacking = 0, []
    for name in names:
        cases = [record["cases"].get(name) for record in (one, other)]
        if None in cases:
            lacking.append(f"{name} is in {(b if cases[0] is None else a).name} alone")
        elif lines := differences(*cases):
            print("\n  ".join([name, *lines[:SHOWN], *([f"and {len(lines) - SHOWN} more"] if lines[SHOWN:] else [])]))
        else:
            same += 1
    print("\n".join([*lacking, f"{same} of {len(names)} cases are the same bit for bit, {len(lacking)} are in one "
                               "record alone"]))
    return int(same < len(names))


def differences(a: dict[str, Any], b: dict[str, Any]) -> list[str]:
    lines = [f"error: {a.get('error')} | {b.get('error')}"] if a.get("error") != b.get("error") else []
    left, right = a["values"], b["values"]
    for name in [name for name in left if name in right]:
        if left[name]["hashes"] != right[name]["hashes"]:
            lines.append(f"{name}: {describe(left[name], right[name])}")
    gone, new = ({name: value for name, value in x.items() if name not in y} for x, y in ((left, right), (right, left)))
    for name, value in gone.items():
        renamed = next((other for other in new if new[other]["hashes"] == value["hashes"]), None)
        if renamed is not None:
            del new[renamed]
        lines.append(f"{name}: in the first alone" if renamed is None else f"{name}: the same, now named {renamed}")
    return lines + [f"{name}: in the second alone" for name in new]


def describe(a: dict[str, Any], b: dict[str, Any]) -> str:
    """Return where two series begin to differ, and by how much."""
    n, m = len(a["hashes"]), len(b["hashes"])
    first = next((k for k in range(min(n, m)) if a["hashes"][k] != b["hashes"][k]), min(n, m))
    return (f"from value {first + 1} of {n}{'' if n == m else f' | {m}'} on; sum {a['sum']:.17g} | {b['sum']:.17g}, "
            f"largest {a['most']:.9g} | {b['most']:.9g}")
