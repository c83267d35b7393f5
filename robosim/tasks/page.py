"""The page of an environment, its docstring: made from its configuration, in the form of Gymnasium's pages."""

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from robosim.config.materials import load_material
from robosim.scene.grains import grain_volume
from robosim.tasks.observation import dose_terms, grain_bounds, tool_bounds
from robosim.tasks.outcome import build_reward
from robosim.tasks.task import load_task


def build_page(name: str) -> str:
    """Write the page of a sub-task, by name or file. Raises ConfigError for a file that cannot be used."""
    task = load_task(name)
    reward = build_reward(task)
    worst, best = reward.extremes()
    (grain_low, grain_high), (tool_low, tool_high) = grain_bounds(task.field.grid), tool_bounds(task, task.field.grid)
    dosed = {} if task.dose is None else {
        "senses": dose_terms(task), "point": 1e3 * load_material(task.material).density.value * grain_volume(task)}
    return _template().render(
        name=name, task=task, worst=worst, best=best, grain_low=grain_low, grain_high=grain_high, tool_low=tool_low,
        tool_high=tool_high, terms={key: term.row(reward.scene) for key, term in reward.terms.items()}, **dosed)


@cache
def _template() -> Template:
    loader = PackageLoader("robosim.tasks")
    return Environment(loader=loader, undefined=StrictUndefined, keep_trailing_newline=True).get_template("page.md.j2")
