"""The pages of speed and of arms, from what `robosim bench` wrote and `robosim rehearse` reported with each arm."""

from generators.markdown import table
from generators.results.measured import origin, outdated, section, stored


def page() -> str:
    """Speed of coupling, kinematics and environments, then of the field alone."""
    whole = stored("bench")
    return "\n".join(["## Coupled step, kinematics, environments\n", origin(whole["made_by"]),
                      outdated("bench", "robosim.studies.benchmarks.bench"),
                      table(["measured", "value"], whole["figures"].items()),
                      "## Field alone\n", section("bench_field", "robosim.studies.benchmarks.field")])


def arms_page() -> str:
    """A row for each arm, gripper and rehearsal."""
    return section("arms", "robosim.commands.runs.rehearse")


def foreign_arms_page() -> str:
    """A row for each arm of another package, and the lines with which some are refused."""
    refused = stored("foreign_arms")
    return "\n".join([section("foreign_arms", "robosim.commands.runs.rehearse"),
                      table(refused["refused_head"], refused["refused"])])
