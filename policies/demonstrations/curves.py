"""Plots of demonstrations: losses over iterations, norms of derivatives over steps."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402

from policies.learning.files import write  # noqa: E402

NORM_LABEL = "|d loss / d positions| [1/m]"


def draw_learning_curves(out: Path, task: str, n: int) -> None:
    """Write learning_curve.png from demonstrations 0 to n - 1 of a folder."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.5), constrained_layout=True)
    for k in range(n):
        with np.load(out / f"demonstration_{k}.npz", allow_pickle=False) as stored:
            left.plot(stored["losses"], label=f"{k}, seed {int(stored['seed'])}")
            norms = stored["norms"]
            right.semilogy(np.arange(len(norms)), np.maximum(norms[:, 0], 1e-30), lw=0.8)
    left.set(xlabel="iteration", ylabel="loss", title=task)
    left.legend(fontsize=7)
    right.set(xlabel="step of the rollout", ylabel=NORM_LABEL, title="derivatives before each step, best iterate")
    _save(figure, out / "learning_curve.png")


def draw_gradient_norms(path: Path, norms: dict[str, dict[str, np.ndarray]]) -> None:
    """Write norms (steps,) over reversed steps to a picture, a panel for each task and a line for each variant.

    norms: task -> variant -> norms.
    """
    columns = min(4, len(norms))
    rows = -(-len(norms) // columns)
    figure, axes = plt.subplots(rows, columns, squeeze=False, sharey=True, figsize=(4.2 * columns, 3.4 * rows),
                                constrained_layout=True)
    for panel, (task, variants) in zip(axes.flat, norms.items()):
        for variant, values in variants.items():
            reversed_norms = values[::-1]
            positive = np.flatnonzero(reversed_norms > 0)
            panel.semilogy(positive, reversed_norms[positive], lw=0.9, label=variant)
        panel.set(title=task, xlabel="reversed step")
    axes[0, 0].set_ylabel(NORM_LABEL)
    axes[0, 0].legend(fontsize=7)
    for panel in axes.flat[len(norms):]:
        panel.set_visible(False)
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    write(path, lambda temporary: figure.savefig(temporary, dpi=120))
    plt.close(figure)
