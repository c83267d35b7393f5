"""The pages of verification cases and of stability, from files of `robosim report` and `robosim stability`."""

import re

from generators.markdown import code, table
from generators.results.measured import origin, outdated, stored
from robosim.base.digests import code_digest
from robosim.studies.verification.cases import NAMES, SUBJECTS, find, module_name
from robosim.studies.verification.stability.field import AXES

VERDICTS = {"pass": "passed", "fail": "**failed**", "not run": "not run"}


def choices(values: dict) -> str:
    """Choices of a run in a line."""
    return ", ".join(f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
                     for key, value in values.items())


def case_section(name: str, result: dict, runs: list[dict]) -> str:
    """Expectations and runs of one case."""
    mine = [run for run in runs if run["case"] == name]
    texts = [re.sub(r"([*<_])", r"\\\1", text) for text in paragraphs(name)]
    parts = [f"### {name}\n", *(f"{text}\n" for text in texts), f"Source: {result['source']}\n"]
    claims = [c for c in result["claims"] if c["verdict"] != "not run"]
    if claims:
        parts.append(table(["expectation", "measured", "accepted from", "to", "verdict"],
                           [[c["claim"], c["found"], c["low"], c["high"], VERDICTS[c["verdict"]]] for c in claims]))
    records = [run["record"] for run in mine if run["record"]]
    if records:
        errors = sorted({key for r in records for key in r["errors"]})
        parts.append(table(["parameters of the run", "particles", "steps", "run time [s]", *errors],
                           [[choices(r["choices"]), r["particles"], r["steps"], r["seconds"],
                             *(r["errors"].get(key) for key in errors)] for r in records]))
    return "\n".join(parts)


def note_on_age(runs: list[dict]) -> str:
    """A note that names the cases whose runs are older than the code that they use."""
    names = [n for n in NAMES if any(r["case"] == n and r["code"] != code_digest(module_name(n)) for r in runs)]
    if not names:
        return ""
    return f":::{{note}}\nMeasured before the code of these cases changed last: {', '.join(names)}. `python " \
           "docs/measure.py report` measures them again.\n:::\n\n"


def paragraphs(name: str) -> list[str]:
    """Paragraphs of a case's docstring: what is simulated; what is measured, and the reference; parameters."""
    texts = (find(name).simulate.__doc__ or "").strip().split("\n\n")
    return [" ".join(text.split()) for text in texts]


def overview() -> str:
    """All cases with subject and summary."""
    return table(["case", "subject", "simulation"],
                 [[code(name), SUBJECTS[name], paragraphs(name)[0]] for name in NAMES])


def page() -> str:
    """All cases, then the expectations and runs of those in the stored report."""
    report = stored("report")
    measured = report["cases"]
    verdicts = [c["verdict"] for result in measured.values() for c in result["claims"]]
    text = f"## Cases\n\n{overview()}\n\n## Results\n\n{origin(report['made_by'])}\n" \
            f"{len(measured)} cases, {len(report['runs'])} runs: " \
            f"{verdicts.count('pass')} expectations met, {verdicts.count('fail')} failed, " \
            f"{verdicts.count('not run')} need runs that `--quick` does not include.\n\n{note_on_age(report['runs'])}"
    return text + "\n".join(case_section(name, result, report["runs"]) for name, result in measured.items())


def stability_page() -> str:
    """Axes of the stability matrix, and the verdicts of the stored cells."""
    report = stored("stability")
    rows = [[cell["axis"], str(cell["value"]), cell["verdict"], cell["reason"]] for cell in report["cells"]]
    return "\n".join([f"Axes: {', '.join(code(axis) for axis in AXES)}.\n", origin(report["made_by"]),
                      outdated("stability", "robosim.studies.verification.stability.field"),
                      table(["axis", "value", "verdict", "reason"], rows)])
