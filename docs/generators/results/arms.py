"""The page of arms, from what `robosim rehearse` reported with each of them."""

from generators.markdown import table
from generators.results.measured import origin, outdated, stored


def page() -> str:
    """A row for each arm, gripper and rehearsal."""
    measured = stored("arms")
    if not measured:
        return "Nothing is stored. `python docs/measure.py arms` measures it.\n"
    return "\n".join([origin(measured["made_by"]), outdated("arms", "robosim.commands.runs.rehearse"),
                      table(measured["head"], measured["rows"])])


def foreign_page() -> str:
    """A row for each arm of another package, and the lines with which some are refused."""
    measured = stored("foreign_arms")
    if not measured:
        return "Nothing is stored. `python docs/measure.py foreign_arms` measures it.\n"
    return "\n".join([origin(measured["made_by"]), outdated("foreign_arms", "robosim.commands.runs.rehearse"),
                      table(measured["head"], measured["rows"]), table(measured["refused_head"], measured["refused"])])
