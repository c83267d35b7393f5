"""The performance page, from what `robosim bench` wrote."""

from generators.markdown import table
from generators.results.measured import origin, outdated, stored


def page() -> str:
    """Speed of coupling, kinematics and environments, then of the field alone."""
    parts = []
    whole = stored("bench")
    if whole:
        figures = whole.get("figures", {})
        parts += ["## Coupled step, kinematics, environments\n", origin(whole["made_by"]),
                  outdated("bench", "robosim.studies.benchmarks.bench"), table(["measured", "value"], figures.items())]
    field = stored("bench_field")
    if field:
        parts += ["## Field alone\n", origin(field["made_by"]),
                  outdated("bench_field", "robosim.studies.benchmarks.field"), table(field["head"], field["rows"])]
    return "\n".join(parts) or "Nothing is stored. `python docs/measure.py bench bench_field` measures it.\n"
