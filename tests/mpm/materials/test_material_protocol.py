"""The protocol of a law: its example runs, and what is incomplete is refused."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from docstring_example import run_example
from element import Element

import mpm
from mpm.backend import once, ti
from mpm.materials.elasticity import Hencky
from mpm.materials.material import PARAMETERS, Material


def test_the_example_of_a_law_gives_its_formula() -> None:
    """tau = 2 mu (1 + factor h : h) h + lam tr(h) I for a stretch along the axes, and at factor 0 Hencky's own. Its
    derivative is not Hencky's, which a rollout would inherit."""
    names = {"dataclass": dataclass, "Hencky": Hencky, "ti": ti, "once": once}
    Stiffening = run_example(Material, "A law whose stress is cubic in the logarithmic strain takes ten lines:",
                             names)["Stiffening"]
    stretches = np.array([1.2, 0.95, 0.9])
    h = np.log(stretches)
    for factor in (0.0, 7.0):
        law = Stiffening(E=1e5, nu=0.2, density=1000.0, factor=factor)
        _, tau = Element(law).apply(np.diag(stretches))
        expected = 2 * law.mu * (1 + factor * (h @ h)) * h + law.lam * h.sum()
        assert tau == pytest.approx(expected, rel=1e-12)
    body = mpm.Body(law, np.full((4, 3), 0.5) + 0.01 * np.arange(4)[:, None], volume=1e-6)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), 0.1), bodies=[body])
    with pytest.raises(mpm.InvalidValue, match="Stiffening has a stress of its own, but the stress_back of Hencky"):
        mpm.Rollout(solver, 1)


@pytest.mark.parametrize("change, message", [
    ({"stress": None}, "has no stress"), ({"state": "strain"}, "state 'strain'"),
    ({"parameters": (0.0,) * (PARAMETERS + 1)}, "9 parameters; accepted: 8"), ({"plastic": True}, "return_mapping"),
    ({"state": "volume", "soften": abs}, "one of them")])
def test_an_incomplete_law_is_refused_by_name(change: dict, message: str) -> None:
    members = {"density": 1e3, "state": "hencky", "plastic": False, "has_volume_correction": False, "mu": 1.0,
               "lam": 1.0, "parameters": (1.0, 1.0), "stress": abs, "energy_density": abs} | change
    law = SimpleNamespace(**{name: value for name, value in members.items() if value is not None})
    with pytest.raises(mpm.InvalidValue, match=message):
        mpm.Body(law, np.zeros((1, 3)), volume=1e-6)
