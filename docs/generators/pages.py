"""Writes everything below docs/_generated before Sphinx reads the pages that include it."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from sphinx.application import Sphinx

from generators import api, catalogue, commands, figures, keys, rooms
from generators.results import dosing, learning, performance, verification
from robosim.studies.verification.cases import CASES, NAMES

PARTS: dict[str, Callable[[], str]] = {
    "commands.md": commands.page,
    "keys.md": keys.page,
    "api_mpm.md": api.mpm_page,
    "api_robosim.md": api.robosim_page,
    "api_policies.md": api.policies_page,
    "verification.md": verification.page,
    "limits.md": verification.limits,
    **{f"cases_{subject}.md": partial(verification.subject_page, subject) for subject in CASES},
    **{f"case_{name}.svg": partial(verification.figure, name) for name in NAMES},
    "stability.md": verification.stability_page,
    "performance.md": performance.page,
    "arms.md": performance.arms_page,
    "dosing.md": dosing.page,
    "foreign_arms.md": performance.foreign_arms_page,
    "learning_scores.md": learning.scores_page,
    "learning_paper.md": learning.paper_page,
    "learning_changes.md": learning.changes_page,
    "learning_changes.svg": learning.changes_figure,
    "learning_networks.md": learning.networks_page,
    "learning_materials.md": learning.materials_page,
    "materials.md": catalogue.materials,
    "tasks.md": catalogue.tasks,
    "senses.md": catalogue.senses,
    "randomization.md": catalogue.randomization,
    "methods.md": catalogue.methods,
    **{f"{draw.__name__}.svg": draw for draw in (figures.weights, figures.cone, figures.stride, figures.shell,
                                                 figures.coupling, figures.checkpoints)},
    "rooms.svg": rooms.figure,
    "rooms.md": rooms.page,
}


def write(app: Sphinx) -> None:
    """Write every part whose text has changed."""
    folder = Path(app.srcdir) / "_generated"
    folder.mkdir(exist_ok=True)
    for name, make in PARTS.items():
        path, text = folder / name, make()
        if not path.is_file() or path.read_text() != text:
            path.write_text(text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to the start of a build."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
