"""Table of what episodes can draw, with the ranges of the preset "wide"."""

from generators.markdown import code, table
from robosim.randomization.ranges import MATERIAL, NUMBERS, wide_ranges
from robosim.tasks.task import load_task


def page() -> str:
    """Every number with its unit, domain, range in "wide" and meaning."""
    wide = wide_ranges(load_task("SpoonScoop"), arm=True)
    rows = [[code(MATERIAL), "", "names", ", ".join(wide[MATERIAL]), "material of the grains, of the same law as the "
             "environment's own"]]
    for name, drawn in NUMBERS.items():
        spread = f"{wide[name][0]:g} to {wide[name][1]:g}" if name in wide else "its task's own"
        needs = {"container": "a container", "loose grains": "a container or a pile", "arm": code("arm=True"),
                 "dose": "a mass to dose"}
        text = drawn.meaning + (f"; with {needs[drawn.needs]}" if drawn.needs else "")
        rows.append([code(name), drawn.unit, f"{drawn.lowest:g} to {drawn.highest:g}", spread, text])
    return table(["name", "unit", "accepted", "in `wide`", "meaning"], rows)
