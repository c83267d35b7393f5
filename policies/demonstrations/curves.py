"""Pictures of demonstrations: losses over iterations, and how derivatives grow backwards in time."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402

from policies.learning.files import write  # noqa: E402


def draw(out: Path, task: str, n: int) -> None:
    """learning_curve.png from the demonstrations in a folder."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.5), constrained_layout=True)
    for k in range(n):
        with np.load(out / f"demonstration_{k}.npz", allow_pickle=False) as stored:
            left.plot(stored["losses"], label=f"{k}, seed {int(stored['seed'])}")
            norms = stored["norms"]
            right.semilogy(np.arange(len(norms)), np.maximum(norms[:, 0], 1e-30), lw=0.8)
    left.set(xlabel="iteration", ylabel="loss", title=task)
    left.legend(fontsize=7)
    right.set(xlabel="step of the roll-out", ylabel="|d loss / d positions| [1/m]",
              title="derivatives before each step, best iterate")
    write(out / "learning_curve.png", lambda place: figure.savefig(place, dpi=120))
    plt.close(figure)
