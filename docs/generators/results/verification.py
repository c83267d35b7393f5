"""The pages of verification cases and of stability, from files of `robosim report` and `robosim stability`."""

import re
from collections import Counter
from functools import cache
from typing import Any

import yaml

from generators.markdown import cell, code, table
from generators.results.case_figures import figure_of
from generators.results.measured import DATA, origin, outdated, stored
from robosim.base.digests import code_digest
from robosim.studies.verification.cases import CASES, NAMES, SUBJECTS, find, module_name
from robosim.studies.verification.cases.case import Record, describe
from robosim.studies.verification.runs import VERDICTS

MARKS = {"pass": "pass", "weak": "**weak**", "fail": "**fail**", "not run": "not run"}


@cache
def report() -> dict[str, Any]:
    """The stored report."""
    return stored("report")


@cache
def reasons() -> dict[str, dict[str, str]]:
    """What limits a case: `line`, in a line, and `more`, in paragraphs. Raises ValueError for an unknown case."""
    content = yaml.safe_load((DATA / "reasons.yaml").read_text())
    if unknown := set(content) - set(NAMES):
        raise ValueError(f"{DATA / 'reasons.yaml'}: no cases {sorted(unknown)}")
    return content


def runs_of(name: str) -> list[dict[str, Any]]:
    """The stored runs of a case."""
    return [run for run in report()["runs"] if run["case"] == name]


def records_of(name: str) -> list[Record]:
    """The records of a case's runs that gave a result."""
    return [Record(**run["record"]) for run in runs_of(name) if run["record"]]


def is_old(name: str) -> bool:
    """Whether a case's runs are older than the code that they use."""
    return any(run["code"] != code_digest(module_name(name)) for run in runs_of(name))


def span(result: dict[str, Any]) -> str:
    """The main error: its name, least and largest value."""
    low, high = result["range"]
    if low is None:
        return result["headline"]
    unit = f" {result['unit']}" if result["unit"] else ""
    ends = cell(low) if low == high else f"{cell(low)} to {cell(high)}"
    return f"{result['headline']}: {ends}{unit}"


def link(name: str) -> str:
    """A link to a case's section, from a page of docs/results."""
    return f"[`{name}`](cases/{SUBJECTS[name]}.md#{name.replace('_', '-')})"


def overview(only: tuple[str, ...] = (), folder: str = "") -> str:
    """All cases, or those of some verdicts, each in a line. folder: of docs/results, from the page's own."""
    cases, rows = report()["cases"], []
    for name in NAMES:
        result = cases.get(name)
        verdict = result["verdict"] if result else "not run"
        if not only or verdict in only:
            text = reasons().get(name, {}).get("line", "")
            old = " (older code)" if result and is_old(name) else ""
            rows.append([link(name).replace("](", f"]({folder}"), span(result) if result else "", MARKS[verdict] + old,
                         text])
    return raw_table(["case", "main error", "verdict", "what limits it"], rows)


def raw_table(head: list[str], rows: list[list[str]]) -> str:
    """A pipe table of cells that are Markdown already."""
    return "\n".join([f"| {' | '.join(head)} |", f"|{'---|' * len(head)}",
                      *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def page() -> str:
    """All cases on one screen."""
    verdicts = Counter(result["verdict"] for result in report()["cases"].values())
    counts = ", ".join(f"{verdicts[key]} {key}" for key in MARKS if verdicts[key])
    return f"{VERDICTS} {len(report()['runs'])} runs; of {len(NAMES)} cases {counts}.\n\n{overview()}\n" \
           f"{origin(report()['made_by'])}"


def limits() -> str:
    """The cases that are not right, with what limits them."""
    return overview(("weak", "fail"), "../results/")


def subject_page(subject: str) -> str:
    """Sections of a subject's cases."""
    return "\n".join(case_section(name) for name in CASES[subject])


def case_section(name: str) -> str:
    """What is simulated, figure, expectations and runs of one case."""
    texts = [escape(text) for text in paragraphs(name)]
    result = report()["cases"].get(name)
    parts = [f"## {name}\n", *(f"{text}\n" for text in texts), f"Source: {find(name).source}\n"]
    reason = reasons().get(name, {})
    if result is None:
        line = f"Not run. What limits it: {reason.get('line', 'not known')}.\n"
        return "\n".join([*parts, line, reason.get("more", "")])
    parts.append(f"**Verdict: {result['verdict']}.** What limits it: {reason.get('line', 'not known')}.\n")
    if is_old(name):
        parts.append(":::{note}\nMeasured before the code of this case changed last. `python docs/measure.py "
                     "report` measures it again.\n:::\n")
    records = records_of(name)
    if records:
        parts.append(f"```{{image}} ../../_generated/case_{name}.svg\n:alt: scene, comparison and errors of {name}\n"
                     "```\n")
    parts += [reason["more"]] if "more" in reason else []
    claims = [c for c in result["claims"] if c["verdict"] != "not run"]
    if claims:
        parts.append(table(["expectation", "measured", "accepted from", "to", "verdict"],
                           [[c["claim"], c["found"], c["low"], c["high"], c["verdict"]] for c in claims]))
    parts += [f"No result at {describe(one['choices'])}: {one['reason']}\n" for one in result["failed"]]
    if records:
        errors = sorted({key for r in records for key in r.errors})
        parts.append(table(["parameters of the run", "particles", "steps", "run time [s]", *errors],
                           [[describe(differing(name, r)), r.particles, r.steps, r.seconds,
                             *(r.errors.get(key) for key in errors)] for r in records]))
    return "\n".join(parts)


def escape(text: str) -> str:
    """Text whose characters mean nothing in Markdown, but for code between backticks, which stays."""
    parts = text.split("`")
    return "`".join(part if n % 2 else re.sub(r"([*<_])", r"\\\1", part) for n, part in enumerate(parts))


def differing(name: str, record: Record) -> dict[str, Any]:
    """The choices of a run that are not those of the case by default, and its resolution."""
    case = find(name)
    return {key: value for key, value in record.choices.items()
            if value != case.defaults.get(key) or key == case.resolution}


def paragraphs(name: str) -> list[str]:
    """Paragraphs of a case's docstring: what is simulated; what is measured, and the reference; parameters."""
    texts = (find(name).simulate.__doc__ or "").strip().split("\n\n")
    return [" ".join(text.split()) for text in texts]


def figure(name: str) -> str:
    """The figure of a case, or nothing where it has no runs."""
    return figure_of(name, records_of(name))


def stability_page() -> str:
    """The stored stability matrix: values of each axis by verdict, and why values are not stable."""
    matrix = stored("stability")
    verdicts = ("stable", "refused", "unstable")
    values: dict[str, dict[str, list[str]]] = {}
    for one in matrix["cells"]:
        values.setdefault(one["axis"], {verdict: [] for verdict in verdicts})[one["verdict"]].append(str(one["value"]))
    counts = [f"{sum(len(axis[verdict]) for axis in values.values())} {verdict}" for verdict in verdicts]
    rows = [[code(axis), *(", ".join(of[verdict]) for verdict in verdicts)] for axis, of in values.items()]
    reasons = [[code(one["axis"]), str(one["value"]), one["reason"]] for one in matrix["cells"] if one["reason"]]
    return "\n".join([f"{len(matrix['cells'])} cells: {', '.join(counts)}. {origin(matrix['made_by'])}",
                      outdated("stability", "robosim.studies.verification.stability.field"),
                      table(["axis", *verdicts], rows), "Why a value is not stable:\n",
                      table(["axis", "value", "reason"], reasons)])
