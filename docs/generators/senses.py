"""Table of the observation terms, from their classes."""

import inspect

from generators.markdown import code, table
from robosim.senses.senses import TERMS, TIMING, accepted_options, find_term


def page() -> str:
    """Every term with its unit, its options and what it shows."""
    rows = []
    for name in TERMS:
        kind = find_term(name)
        own = [option for option in accepted_options(kind) if option not in (*TIMING, "key")]
        text = " ".join(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].split())
        rows.append([code(name), kind.unit, ", ".join(map(code, own)), text])
    return table(["term", "unit", "options", "what it shows"], rows)
