"""The section `reward` of a task's file: a key for each term."""

from functools import lru_cache
from typing import Annotated, Any

import pydantic
from pydantic import Field

from mpm.errors import say_unknown
from robosim.config.table import Table
from robosim.rewards.term import KINDS, RewardTerm

DOSE = {"error": 10.0, "time": 1.0, "spill": 5.0}
"""The reward of a dosing task whose file does not say otherwise."""
WITHOUT = {"distance": None, "target": None, "poured": 0.0, "lost": 0.0, "contact": 0.0, "collision": 0.0, "turn": None}
"""What is written for the published terms that a reward with a target lacks: networks and tables of results know a task
by all these keys."""


def read_terms(given: Any) -> dict[str, RewardTerm]:
    """Return the terms of a section; 0 and null stand for none. Raises ValueError, pydantic.ValidationError."""
    if not isinstance(given, dict):
        raise ValueError(f"{given!r:.60}; accepted: a table of {', '.join(KINDS)}")
    unknown = [name for name in given if name not in KINDS]
    if unknown:
        raise ValueError(say_unknown("term", unknown[0], list(KINDS)))
    chosen = {name: value for name, value in given.items() if value is not None and value != 0}
    if "target" in chosen and "poured" not in chosen:
        chosen.setdefault("lost", 0.0)  # shown without a weight, too
    section = _build_section(*KINDS.values()).model_validate(chosen)
    return {name: getattr(section, name) for name in KINDS if name in chosen}


def write_terms(terms: dict[str, RewardTerm]) -> dict[str, Any]:
    """Return the content of the section that `read_terms` reads as these terms."""
    return (WITHOUT if "target" in terms else {}) | {name: term.model_dump() for name, term in terms.items()}


@lru_cache
def _build_section(*kinds: type[RewardTerm]) -> type[Table]:
    keys: dict[str, Any] = {}
    for kind in kinds:
        shape: Any = Annotated[kind, pydantic.WithJsonSchema(kind.model_json_schema())] if kind.is_number() else kind
        keys[kind.name] = (shape | None, Field(None, description=" ".join((kind.__doc__ or "").split())))
    return pydantic.create_model("Reward", __base__=Table, __doc__="Terms of the reward.", **keys)


class _Keys:
    """The schema of the section: a key for each term that is known by then."""

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: pydantic.GetJsonSchemaHandler) -> Any:
        return handler(_build_section(*KINDS.values()).__pydantic_core_schema__)


RewardTerms = Annotated[dict[str, RewardTerm], pydantic.PlainValidator(read_terms),
                        pydantic.PlainSerializer(write_terms), _Keys]
"""Name -> term, in the order in which they are summed."""
