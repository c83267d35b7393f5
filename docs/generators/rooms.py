"""The folders of the packages and which of them import which, from the syntax trees."""

import ast
import re
from functools import lru_cache
from graphlib import TopologicalSorter
from html import escape
from pathlib import Path

from generators.markdown import code, table
from generators.results.measured import ROOT

PACKAGES = ("mpm", "robosim", "policies")
COLOURS = {"mpm": "#d8e8f6", "robosim": "#e3f1dd", "policies": "#f8e9d2"}
WIDTH, HEIGHT, GAP = 118, 30, 44


def room(module: str) -> str:
    """`mpm.scene.grid` -> `mpm.scene`; a file at the top of a package belongs to the package itself."""
    path = ROOT.joinpath(*module.split("."))
    folder = path if path.is_dir() else path.parent
    parts = folder.relative_to(ROOT).parts[:2]
    return ".".join(parts)


@lru_cache
def arrows() -> dict[str, set[str]]:
    """Room -> rooms that its files import."""
    result: dict[str, set[str]] = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            here = room(module)
            if path.parent == ROOT / package and path.name == "__init__.py":
                continue  # a package's own `__init__` names what users import: it stands above its rooms
            targets = result.setdefault(here, set())
            for node in ast.walk(ast.parse(path.read_text())):
                names = []
                if isinstance(node, ast.Import):
                    names = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and node.module:
                    names = [node.module]
                for name in names:
                    if name.split(".")[0] in PACKAGES:
                        targets.add(room(name))
    return {here: targets - {here} for here, targets in result.items()}


def below(graph: dict[str, set[str]], here: str) -> set[str]:
    """All rooms that a room reaches."""
    return set().union(*({other} | below(graph, other) for other in graph.get(here, ())))


def reduced(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The arrows that do not follow from others."""
    reach = {here: below(graph, here) for here in graph}
    return {here: {t for t in targets if not any(t in reach.get(o, ()) for o in targets - {t})}
            for here, targets in graph.items()}


def package_graph(package: str) -> dict[str, set[str]]:
    """Arrows within a package; files at its top are left out."""
    return {here: {t for t in targets if t.startswith(f"{package}.")}
            for here, targets in arrows().items() if here.startswith(f"{package}.")}


def floors(graph: dict[str, set[str]]) -> list[list[str]]:
    """Rooms by the length of the longest way down, lowest first."""
    sorter, rows = TopologicalSorter(graph), []
    sorter.prepare()
    while rooms := sorter.get_ready():
        rows.append(sorted(rooms))
        sorter.done(*rooms)
    return rows


def drawn(package: str, left: float, top: float, width: float) -> tuple[str, float]:
    """One package as SVG, and its height."""
    graph = package_graph(package)
    rows = floors(graph)[::-1]
    place, parts = {}, []
    for k, row in enumerate(rows):
        step = width / len(row)
        for i, here in enumerate(row):
            place[here] = (left + step * (i + 0.5), top + 40 + k * (HEIGHT + GAP))
    for here, targets in reduced(graph).items():
        for target in targets:
            (x0, y0), (x1, y1) = place[here], place[target]
            y0 += HEIGHT
            parts.append(f'<path d="M{x0:.0f},{y0:.0f} C{x0:.0f},{y0 + 22:.0f} {x1:.0f},{y1 - 22:.0f} {x1:.0f},'
                         f'{y1 - 3:.0f}" class="arrow" marker-end="url(#tip)"/>')
    for here, (x, y) in place.items():
        parts.append(f'<rect x="{x - WIDTH / 2:.0f}" y="{y:.0f}" width="{WIDTH}" height="{HEIGHT}" rx="5" '
                     f'fill="{COLOURS[package]}" class="room"/><text x="{x:.0f}" y="{y + 20:.0f}">'
                     f'{escape(here.split(".", 1)[1])}</text>')
    height = 40 + len(rows) * (HEIGHT + GAP)
    frame = f'<rect x="{left - 6:.0f}" y="{top:.0f}" width="{width + 12:.0f}" height="{height:.0f}" class="package"/>' \
            f'<text x="{left + width / 2:.0f}" y="{top + 24:.0f}" class="name">{package}</text>'
    return frame + "".join(parts), height


def figure() -> str:
    """All packages, beside each other."""
    widths = [max(len(row) for row in floors(package_graph(p))) * (WIDTH + 14) for p in PACKAGES]
    bodies, heights, left = [], [], 12.0
    for package, width in zip(PACKAGES, widths):
        body, height = drawn(package, left, 8, width)
        bodies.append(body)
        heights.append(height)
        left += width + 26
    style = "text{font:13px sans-serif;text-anchor:middle;fill:#223}.name{font-weight:bold;font-size:16px}" \
            ".room{stroke:#8896a8}.package{fill:#fbfcfd;stroke:#c4ccd6}.arrow{fill:none;stroke:#8a94a2;stroke-width:1.1}"
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {left:.0f} {max(heights) + 16:.0f}">' \
           f'<style>{style}</style><defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" ' \
           f'markerHeight="7" orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="#8a94a2"/></marker></defs>' \
           f'{"".join(bodies)}</svg>\n'


def purpose(here: str) -> str:
    """First paragraph of a room's docstring."""
    text = ast.get_docstring(ast.parse(Path(ROOT, *here.split("."), "__init__.py").read_text())) or ""
    return re.sub(r"\s*Imports:.*", "", " ".join(text.split("\n\n")[0].split()))


def page() -> str:
    """A table of the rooms of each package."""
    return "\n".join(f"### {package}\n\n" + table(
        ["folder", "holds", "imports"],
        [[code(here.split(".", 1)[1]), purpose(here), ", ".join(sorted(t.split(".", 1)[1] for t in targets))]
         for here, targets in sorted(package_graph(package).items())]) for package in PACKAGES)
