"""Figures of the concept pages, drawn while the site is built."""

import io
from collections.abc import Callable

import matplotlib as mpl
import numpy as np

mpl.use("svg")
from matplotlib import pyplot as plt  # noqa: E402  (the backend comes first)
from matplotlib.axes import Axes  # noqa: E402

BLUE, ORANGE, GREY, GREEN = "#2f6fa8", "#c9722b", "#8a94a2", "#4b8f4e"
STYLE = {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "robosim",
         "axes.edgecolor": "#556", "figure.dpi": 90}


def drawn(size: tuple[float, float], draw: Callable[[Axes], None]) -> str:
    """An SVG of one set of axes."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=size, layout="constrained")
        draw(axes)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
        plt.close(figure)
    return text.getvalue()


def weights() -> str:
    """The quadratic B-spline over the nodes."""
    def draw(axes: Axes) -> None:
        d = np.linspace(-2.5, 2.5, 500)
        for node in (-1, 0, 1):
            a = np.abs(d - node)
            w = np.where(a < 0.5, 0.75 - a**2, np.where(a < 1.5, 0.5 * (1.5 - a) ** 2, 0.0))
            axes.plot(d, w, color=BLUE if node == 0 else GREY, lw=2 if node == 0 else 1)
        axes.axvline(0.3, color=ORANGE, ls="--", lw=1)
        axes.annotate("particle", (0.3, 0.8), color=ORANGE, ha="left", xytext=(4, 0), textcoords="offset points")
        axes.set(xlabel="distance from node 0 [cells]", ylabel="weight", ylim=(0, 0.9), xticks=range(-2, 3))
    return drawn((5.2, 2.4), draw)


def cone() -> str:
    """Return mapping of the Drucker-Prager law in the plane of pressure and shear."""
    def draw(axes: Axes) -> None:
        p = np.linspace(0, 3, 10)
        axes.fill_between(p, 0, 0.8 * p, color=BLUE, alpha=0.12)
        axes.plot(p, 0.8 * p, color=BLUE, lw=2)
        for begin, end in (((2.0, 2.5), (2.0, 1.6)), ((-0.7, 0.6), (0.0, 0.0)), ((2.3, 0.9), (2.3, 0.9))):
            axes.plot(*begin, "o", color=ORANGE, ms=6)
            if begin != end:
                axes.annotate("", end, begin, arrowprops={"arrowstyle": "-|>", "color": ORANGE})
        axes.annotate("shear: scale the deviator", (1.92, 2.5), color=ORANGE, ha="right", va="center")
        axes.annotate("expansion:\nno stress", (-0.95, 0.78), color=ORANGE)
        axes.annotate("elastic", (2.35, 0.75), color=ORANGE)
        axes.axvline(0, color="#556", lw=0.8)
        axes.set(xlabel="pressure", ylabel="shear stress", xlim=(-1, 3.6), ylim=(0, 2.8), xticks=[], yticks=[])
    return drawn((5.2, 2.8), draw)


def stride() -> str:
    """When particles move and strain, and when nodes change their velocity, in a stride of three substeps."""
    def draw(axes: Axes) -> None:
        for k, text in enumerate(("half\na kick", "kick", "kick", "half\na kick")):
            axes.plot([k, k], [0.19, 0.42], color=GREY, lw=1)
            axes.annotate(text, (k, 0.68), ha="center", va="center", fontsize=8.5)
        for k in range(3):
            axes.annotate("strain", (k + 0.5, 0.68), ha="center", va="center", fontsize=8.5, color=GREY)
        axes.annotate("", (1.5, 0.24), (0, 0.24), arrowprops={"arrowstyle": "-|>", "color": GREEN, "lw": 1.6})
        axes.annotate("", (3.0, 0.24), (1.5, 0.24), arrowprops={"arrowstyle": "-|>", "color": ORANGE, "lw": 1.6})
        axes.annotate("drift with the old velocity", (0.75, 0.1), ha="center", color=GREEN, fontsize=8.5)
        axes.annotate("drift with the new velocity", (2.25, 0.1), ha="center", color=ORANGE, fontsize=8.5)
        for x, text in ((0, "scatter"), (3, "gather")):
            axes.annotate(text, (x, 1.05), ha="center", color=BLUE)
        axes.set(xlim=(-0.3, 3.3), ylim=(0, 1.2), xlabel="substeps", xticks=range(4), yticks=[])
        axes.spines["left"].set_visible(False)
    return drawn((6.0, 2.0), draw)


def shell() -> str:
    """Nodes and particles on the two sides of a thin shell."""
    def draw(axes: Axes) -> None:
        x = np.linspace(0, 6, 200)
        y = 1.5 + 0.35 * np.sin(0.9 * x)
        axes.plot(x, y, color="#222", lw=3)
        X, Y = np.meshgrid(np.arange(7), np.arange(4))
        above = 1.5 + 0.35 * np.sin(0.9 * X) < Y
        axes.scatter(X[above], Y[above], marker="s", s=26, color=BLUE, label="nodes above: first layer for their side")
        axes.scatter(X[~above], Y[~above], marker="s", s=26, color=ORANGE, label="nodes below")
        rng = np.random.default_rng(1)
        grains = rng.uniform((0, 1.9), (6, 3), (40, 2))
        grains = grains[grains[:, 1] > 1.62 + 0.35 * np.sin(0.9 * grains[:, 0])]
        axes.scatter(*grains.T, s=12, color=GREY, label="particles")
        axes.set(xlim=(-0.3, 6.3), ylim=(-0.4, 3.4), aspect="equal")
        axes.axis("off")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=3, frameon=False, fontsize=8)
    return drawn((6.2, 3.6), draw)


def coupling() -> str:
    """One coupled step as a sequence."""
    steps = ["read pose, twist,\nprobe mobility", "predict\nthe motion", "advance field and\ntwist together",
             "apply impulse,\nmj_step", "compare", "close\nledger"]

    def draw(axes: Axes) -> None:
        for k, text in enumerate(steps):
            colour = ORANGE if k == 2 else BLUE
            axes.annotate(text, (1.75 * k, 0), ha="center", va="center", fontsize=8.5,
                          bbox={"boxstyle": "round,pad=0.45", "fc": "white", "ec": colour, "lw": 1.4})
            if k:
                axes.annotate("", (1.75 * k - 0.72, 0), (1.75 * (k - 1) + 0.72, 0),
                              arrowprops={"arrowstyle": "-|>", "color": GREY})
        axes.annotate("", (3.5, -0.45), (7.0, -0.32), arrowprops={
            "arrowstyle": "-|>", "color": ORANGE, "connectionstyle": "arc3,rad=-0.25"})
        axes.annotate("prediction missed: roll back and repeat", (5.25, -1.2), ha="center", color=ORANGE, fontsize=8.5)
        axes.set(xlim=(-1.0, 9.6), ylim=(-1.4, 0.7))
        axes.axis("off")
    return drawn((8.6, 1.9), draw)


def checkpoints() -> str:
    """States that a rollout of 27 steps stores at two levels."""
    def draw(axes: Axes) -> None:
        axes.plot([0, 27], [0, 0], color="#556")
        for x in range(0, 28, 9):
            axes.plot(x, 0, "s", color=BLUE, ms=9)
        for x in range(18, 28, 3):
            axes.plot(x, 0, "o", color=ORANGE, ms=6)
        axes.annotate("", (23.8, 0.35), (27, 0.35), arrowprops={"arrowstyle": "-|>", "color": ORANGE})
        axes.annotate("backward", (25.4, 0.5), ha="center", color=ORANGE, fontsize=8.5)
        axes.annotate("checkpoints of the first level", (4.5, -0.55), ha="center", color=BLUE, fontsize=8.5)
        axes.annotate("recomputed between two of them", (22.5, -0.55), ha="center", color=ORANGE, fontsize=8.5)
        axes.set(xlim=(-1, 28), ylim=(-0.8, 0.8))
        axes.axis("off")
    return drawn((6.2, 1.3), draw)
