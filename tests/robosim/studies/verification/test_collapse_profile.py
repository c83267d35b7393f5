"""Profiles of deposits: the analysis of analytic heaps, the law of dense sand, and a coarse column."""

import math
from dataclasses import replace

import numpy as np
import pytest

import mpm
from robosim.base.errors import UnknownName
from robosim.studies.verification.cases.case import Cost, TimedSolver, make_record
from robosim.studies.verification.cases.dense_sand import DenseSand, dense_sand, shear_ratio
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.granular import collapse_profile as module
from robosim.studies.verification.cases.granular.collapse_profile import Profile, closed_depths, profile_difference
from robosim.studies.verification.cases.granular.element import CELL, DT, deform, stress

CASE = module.collapse_profile


def heap_of(summit: float, rim: float, share: float) -> Profile:
    """Profile of a cone of many small particles, a share of the whole round."""
    spacing = 0.01
    n = math.ceil(rim / spacing)
    x, y = (axis.ravel() * spacing for axis in np.meshgrid(*[np.arange(-n, n) + 0.5] * 2))
    if share == 0.25:
        x, y = x[(x > 0) & (y > 0)], y[(x > 0) & (y > 0)]
    radii = np.hypot(x, y)
    return module.measure_profile(radii, spacing**2 * summit * np.clip(1 - radii / rim, 0, 1), share)


@pytest.mark.parametrize(("summit", "rim", "share"), [(0.9, 2.24, 1.0), (0.9, 2.24, 0.25), (0.5, 1.62, 0.25)])
def test_a_cone_has_its_rim_summit_and_volume(summit: float, rim: float, share: float) -> None:
    """The rim is where the cone is THIN, which lies by THIN / slope inside its edge."""
    profile, volume = heap_of(summit, rim, share), math.pi * summit * rim**2 / 3
    assert module.find_summit(profile) == pytest.approx(summit, rel=0.01)
    assert module.find_rim(profile) == pytest.approx(rim * (1 - module.THIN / summit), abs=0.02)
    assert module.volume_of(profile) == pytest.approx(volume, rel=5e-3)
    assert profile_difference(profile, closed_depths(profile.radii, summit, rim, volume)) < 0.02
    wider = closed_depths(profile.radii, summit, 1.3 * rim, volume)
    assert profile_difference(profile, wider) > 0.1
    assert profile_difference(Profile(profile.radii, 1.1 * profile.depths), wider) == pytest.approx(
        profile_difference(profile, wider), rel=1e-9)


@pytest.mark.parametrize(("summit", "rim", "volume"), [(0.9, 2.24, math.pi), (1.1, 4.2, 4 * math.pi),
                                                       (0.5, 1.62, math.pi / 2)])
def test_closed_profile_has_the_volume_and_the_ends(summit: float, rim: float, volume: float) -> None:
    r = np.linspace(0.0, rim, 4001)
    h = closed_depths(r, summit, rim, volume)
    assert np.sum(2 * math.pi * r * h) * (r[1] - r[0]) == pytest.approx(volume, rel=1e-4)
    assert (h[0], h[-1]) == pytest.approx((summit, 0.0), abs=1e-12) and np.all(np.diff(h) <= 0)


def test_a_volume_that_no_profile_has_is_refused() -> None:
    with pytest.raises(ValueError, match="accepted: above 0, below 3.14"):
        closed_depths(np.zeros(1), 1.0, 1.0, 4.0)


def test_a_law_that_the_case_lacks_is_refused() -> None:
    with pytest.raises(UnknownName, match="drucker_prager"):
        module.make_law("cam_clay", 1e5, 0.7)


def test_relative_density_sets_peak_dilation_and_room() -> None:
    """Bolton's index is held at 4, from a relative density of 0.5 on; the room still grows."""
    loose, medium, dense = (dense_sand(d, E=1e5, nu=0.3, density=1600.0) for d in (0.3, 0.5, 0.9))
    assert (loose.peak_angle_deg, medium.peak_angle_deg, dense.peak_angle_deg) == pytest.approx((39.0, 45.0, 45.0))
    assert loose.room < medium.room < dense.room and loose.dilation < medium.dilation == dense.dilation
    with pytest.raises(mpm.InvalidValue, match="peak_angle_deg = 30"):
        DenseSand(E=1e5, nu=0.3, density=1600.0, friction_angle_deg=33.0, peak_angle_deg=30.0, dilation=0.2, room=0.1)


PATHS = {"compression": np.diag([1.001, 1.001, 1.001**-2]), "extension": np.diag([0.999, 0.999, 0.999**-2]),
         "shear": np.array([[1.0, 0.0, 3e-3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])}
"""Deformation of a step: at constant volume."""


@pytest.mark.parametrize("path", PATHS)
def test_dense_sand_flows_on_its_surface_and_dilates_to_the_critical_state(path: str) -> None:
    """Peak and critical angle are those of triaxial compression and extension; simple shear has `shear_ratio`.
    At constant volume dilation adds elastic pressure: what the grains remember, and the elastic strain, cancel."""
    law = DenseSand(E=1e6, nu=0.3, density=1500.0, friction_angle_deg=33.0, peak_angle_deg=42.0, dilation=0.2,
                    room=0.05)
    body = mpm.Body(law, np.random.default_rng(0).uniform(0.4, 0.6, (4, 3)), volume=0.2**3 / 4)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), CELL), bodies=[body], gravity=(0, 0, 0), dt=DT,
                        precision="f64", integrator="exact", transfer_interval=0.0)
    timed, state = TimedSolver(solver), solver.state()
    state["v"][:], state["C"][:], state["e"][:, :3] = 0.0, 0.0, np.expm1(-2 * 0.01)

    def angle() -> float:
        """Angle [deg] of triaxial compression that the present stress belongs to."""
        least, mean, most = np.linalg.eigvalsh(-stress(law, state))
        if path != "shear":
            return math.degrees(math.asin((most - least) / (most + least)))
        ratio = (most - least) / 2 / mean
        return math.degrees(math.asin(math.sqrt(3 * ratio**2 / (4 - ratio**2))))

    angles, remembered = [], []
    for _ in range(500):
        state = deform(timed, state, PATHS[path])
        angles.append(angle())
        remembered.append(float(np.ravel(state["vc"])[0]))
    assert max(angles) == pytest.approx(42.0, abs=0.4) and angles[-1] == pytest.approx(33.0, abs=0.4)
    assert np.all(np.diff(remembered) >= 0) and remembered[-1] == pytest.approx(0.05, rel=0.02)
    volume = 0.5 * np.log(np.linalg.det(np.eye(3) + state["e"][0][[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]))
    assert volume + remembered[-1] == pytest.approx(-0.03, abs=1e-5)
    assert shear_ratio(33.0) == pytest.approx(math.tan(math.radians(31.2)), abs=0.01)


def test_an_error_that_passes_zero_fails_and_sleep_does_not_hide_vibration() -> None:
    """A run-out that goes from -9 to +0.4 % has not converged; what moves once it is woken is not at rest."""
    def verdicts(name: str, *runs: tuple[int, dict[str, float]]) -> set[str]:
        records = [replace(make_record([Cost(1, 1, 1.0)], errors),
                           choices={**CASE.defaults, "cells": n}) for n, errors in runs]
        wanted = [one for one in CASE.expectations if one.name == name and not (
            isinstance(one, Within) and "cells" in one.where)]
        return {one.evaluate(records).verdict for one in wanted} - {"not run"}

    assert verdicts("run-out", *((n, {"run-out": e}) for n, e in ((12, -0.09), (16, -0.05), (24, 0.004)))) == {"fail"}
    assert verdicts("run-out", *((n, {"run-out": e}) for n, e in ((12, -0.09), (16, -0.05), (24, -0.03)))) == {"pass"}
    assert verdicts("drift", (24, {"drift": 0.0})) == {"pass"}
    assert verdicts("drift, woken", (24, {"drift, woken": 2e-3})) == {"fail"}
