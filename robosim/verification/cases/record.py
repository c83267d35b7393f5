"""The record of one run of a case: its choices, its cost and its errors, as a line of JSON."""

import json
from dataclasses import asdict, dataclass, field


@dataclass(frozen=True)
class Record:
    """One run of a case."""

    case: str
    """Name of the case."""
    choices: dict[str, float | str | bool | None]
    """Arguments of `measure`: cells, courant, precision and those of the case."""
    particles: int
    """Number of particles."""
    steps: int
    """Number of substeps."""
    seconds: float
    """Wall time [s] after compilation."""
    compile_seconds: float
    """Wall time [s] of compilation."""
    errors: dict[str, float]
    """Errors against the reference, relative to the case's own scale unless the name states a unit."""
    readings: dict[str, float] = field(default_factory=dict)
    """Other figures, without an accepted range."""
    peak_bytes: int = 0
    """Largest memory of the process [bytes]."""

    def to_json(self) -> str:
        """Return the record as one line of JSON."""
        return json.dumps(asdict(self))
