"""Tables of the bundled materials, sub-tasks and methods, from configs/; of what episodes draw and tasks observe."""

import inspect
from typing import Any

import yaml

from generators.markdown import code, table
from generators.results.measured import ROOT
from robosim.envs import BUNDLED
from robosim.randomization.ranges import MATERIAL, NUMBERS, hard_ranges, wide_ranges
from robosim.senses.senses import TERMS, TIMING, accepted_options, find_term
from robosim.tasks.task import load_task

CONFIGS = ROOT / "configs"
SYMBOLS = {"density": "density [kg/m^3]", "E": "E [Pa]", "nu": "nu", "friction_angle": "friction angle [deg]",
           "cohesion": "cohesion [Pa]", "bulk_modulus": "bulk modulus [Pa]", "viscosity": "viscosity [Pa s]",
           "yield_stress": "yield stress [Pa]", "limit_angle": "friction angle at infinite rate [deg]",
           "grain_diameter": "grain diameter [m]", "grain_density": "grain density [kg/m^3]",
           "inertial_number": "inertial number", "wall_friction": "wall friction",
           "repose_angle": "angle of repose [deg]"}


def read(folder: str) -> dict[str, dict[str, Any]]:
    """Name -> content of every file in a folder of configs."""
    return {path.stem: yaml.safe_load(path.read_text()) for path in sorted((CONFIGS / folder).glob("*.yaml"))}


def materials() -> str:
    """Every material with its numbers and their sources; YAML reads 5e-4 as text, the schema as a number."""
    parts = []
    for name, data in read("materials").items():
        rows = [[SYMBOLS[key], f"{float(number['value']):g}", number["source"]] for key, number in data.items()
                if isinstance(number, dict)]
        text = data["description"]
        parts.append(f"### {name}\n\n{text[:1].upper()}{text[1:]}. Law: {data['law']}.\n\n"
                     + table(["number", "value", "source"], rows))
    return "\n".join(parts)


def tasks() -> str:
    """The bundled tasks."""
    data = read("tasks")
    return table(["id", "tool", "particles", "terms of the reward", "goal"],
                 [[f"`robosim/{name}-v0`", data[name]["tool"], data[name]["grains"]["count"],
                   ", ".join(load_task(name).reward), data[name]["description"]] for name in BUNDLED])


def methods() -> str:
    """The methods of learning."""
    return table(["method", "learner", "observation", "description"],
                 [[code(name), data["learner"], data.get("obs", "flat"), data["description"]]
                  for name, data in read("training").items()])


def randomization() -> str:
    """Every number that episodes can draw, with its unit, domain, ranges in "wide" and "hard", and meaning."""
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


def senses() -> str:
    """Every observation term with its unit, its options and what it shows."""
    rows = []
    for name in TERMS:
        kind = find_term(name)
        own = [option for option in accepted_options(kind) if option not in (*TIMING, "key")]
        text = " ".join(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].split())
        rows.append([code(name), kind.unit, ", ".join(map(code, own)), text])
    return table(["term", "unit", "options", "what it shows"], rows)
