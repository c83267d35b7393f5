"""The page of the dosing benchmark: metrics of the entries of docs/results/data/dosing, ours and those of others."""

from dosing_benchmark import DRAWS, HEAD, measure, read_entry

from generators.markdown import table
from generators.results.measured import DATA, ROOT


def page() -> str:
    """A table for each entry, and a dose as a picture that moves where there is one."""
    parts = []
    for entry in (read_entry(path.read_text()) for path in sorted((DATA / "dosing").glob("*.json"))):
        note = "" if entry.draws >= DRAWS else f" **{entry.draws} of {DRAWS} draws: too few to compare.**"
        picture = f"images/{entry.task}.webp"
        shown = f"```{{image}} ../{picture}\n:alt: A dose\n:class: figure\n```\n\n" \
            if (ROOT / "docs" / picture).is_file() else ""
        parts.append(f"### {entry.task}: {entry.name}\n\n{entry.kind}, `{entry.source}`.{note}\n\n{shown}"
                     + table(HEAD, measure(entry)))
    return "\n".join(parts)
