"""Text and page of `robosim explain`."""

from typing import Any

from robosim.base.output_folder import OutputFolder
from robosim.reports.page import Page
from robosim.reports.plot import Plot


def describe_setting(setting: dict[str, float]) -> str:
    """Format a setting, factors on the scene's own numbers."""
    return ", ".join(f"{key} x {value:g}" for key, value in setting.items()) or "own setting"


def format_parts(result: dict[str, Any]) -> list[str]:
    """Format parts, costs and readings of a run as lines for a terminal."""
    lines = [f"{result['grains']} grains, cells of {1e3 * result['cell_m']:g} mm, "
             f"steps of {1e6 * result['dt_s']:.4g} us"]
    for is_present in (True, False):
        lines.append("compiled in:" if is_present else "left out:")
        for part in result["parts"]:
            if part["present"] == is_present:
                memory = f"  [{part['bytes'] / 1e6:.3g} MB]" if part["bytes"] else ""
                lines.append(f"  {part['name']}: {part['reason']}{memory}")
    lines.append("seconds per simulated second:")
    lines += [f"  {name}: {value:.3f}" for name, value in result["costs"].items()]
    lines.append("readings: " + ", ".join(f"{key} {value:.4g}" for key, value in result["readings"].items()))
    return lines


def write_page(scene: str, own: dict[str, Any], rows: list[dict[str, Any]] | None, folder: OutputFolder) -> None:
    """Write index.html and print its path.

    own: result of the scene's own setting. rows: of `compare_settings`; None without a comparison.
    """
    page = Page(f"Parts and cost of {scene}")
    page.add_table(["part", "compiled in", "reason", "MB"],
                   [[p["name"], "yes" if p["present"] else "no", p["reason"],
                     p["bytes"] / 1e6 if p["bytes"] else None] for p in own["parts"]])
    page.add_heading("Seconds per simulated second")
    page.add_table(["part", "seconds"], own["costs"].items())
    page.add_heading("Readings")
    page.add_table(["reading", "value"], own["readings"].items())
    if rows is not None:
        _add_settings(page, scene, rows, list(own["readings"]))
    folder.write_text("index.html", page.html())
    print(folder.path / "index.html")


def _add_settings(page: Page, scene: str, rows: list[dict[str, Any]], readings: list[str]) -> None:
    """Add a plot and a table of settings, with the errors of their readings."""
    plot = Plot(scene, "seconds", "error of the worst reading")
    for row in rows:
        name = describe_setting(row["setting"])
        errors = "\n".join(f"{reading} {value:.3%}" for reading, value in row["errors"].items())
        if row["error"] > 0.0:  # zero has no place on a logarithmic axis
            plot.add_series([(row["seconds"], row["error"])], [f"{name}\n{errors}"], name)
        else:
            plot.add_reference(row["seconds"], name)
    page.add_heading("Settings")
    page.add_plot(plot.html(), "Dashed: settings whose results are those of the finest, to which the others are "
                               "compared.")
    page.add_table(["setting", "seconds", "speed-up over the finest", *(f"error of {key}" for key in readings)],
                   [[describe_setting(r["setting"]), r["seconds"], r["speedup"], *(r["errors"][k] for k in readings)]
                    for r in rows])
