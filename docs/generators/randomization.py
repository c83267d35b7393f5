"""Table of what episodes can draw, with the ranges of the presets "wide" and "hard"."""

from generators.markdown import code, table
from robosim.randomization.ranges import MATERIAL, NUMBERS, hard_ranges, wide_ranges
from robosim.tasks.task import load_task


def page() -> str:
    """Every number with its unit, domain, ranges in "wide" and "hard", and meaning."""
    wide, hard = (ranges(load_task("SpoonScoop"), arm=True) for ranges in (wide_ranges, hard_ranges))
    rows = [[code(MATERIAL), "", "names", ", ".join(wide[MATERIAL]), "as in `wide`", "material of the grains, of "
             "the same law as the environment's own"]]
    for name, drawn in NUMBERS.items():
        spread = [f"{one[name][0]:g} to {one[name][1]:g}" if name in one else "its task's own" for one in (wide, hard)]
        needs = {"container": "a container", "loose grains": "a container or a pile", "arm": code("arm=True"),
                 "dose": "a mass to dose"}
        text = drawn.meaning + (f"; with {needs[drawn.needs]}" if drawn.needs else "")
        rows.append([code(name), drawn.unit, f"{drawn.lowest:g} to {drawn.highest:g}", *spread, text])
    return table(["name", "unit", "accepted", "in `wide`", "in `hard`", "meaning"], rows)
