"""A feature that is there but idle changes nothing, to the bit; what is absent takes no memory."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mpm
from mpm.stepping.phases import phases_of


@pytest.mark.long
@pytest.mark.parametrize(("how", "features"), [
    ("together", ["all"]),
    pytest.param("apart", ["moving collider", "mobile collider", "static collider", "second body", "shell", "orifice",
                           "body acceleration", "sleep", "stride"], marks=pytest.mark.slow)])
def test_idle_features_equal_absent_ones(how: str, features: list[str]) -> None:
    script = Path(__file__).with_name("idle_features.py")
    # the packages of this run, whether installed or lying beside the tests
    environment = os.environ | {"PYTHONPATH": str(Path(mpm.__file__).parent.parent)}
    done = subprocess.run([sys.executable, str(script), how], capture_output=True, text=True, timeout=300,
                          env=environment)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.strip().splitlines()[-1]) == dict.fromkeys(features, True)


def test_absent_features_take_no_memory() -> None:
    positions = mpm.sample_box((0, 0, 0), (0.1, 0.1, 0.1), 0.02)
    water = mpm.Body(mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0), positions, volume=8e-6)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[water])
    assert solver.particles.e == [] and solver.particles.vc is None
    assert solver.fields.static_contact is None and solver.fields.shells is None and solver.fields.orifices is None
    assert solver.fields.sleepers is None and solver.particles.rest is None
    assert solver.fields.mobile_nodes is None and solver.features.mobile == ()
    assert solver.particles.side is None and solver.particles.acceleration == [] and solver.fields.grid.layers == 1
    assert {"e", "rest", "orifices"}.isdisjoint(solver.state())
    assert solver.awake.all() and not np.any(np.concatenate(solver.sleepers_impulse))
    assert "settle with sleepers" not in [phase.name for phase in phases_of(solver.fields)]
    sand = mpm.DruckerPrager(E=1e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)
    body = mpm.Body(sand, positions, volume=8e-6)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body])
    assert solver.particles.j is None and solver.particles.vc is not None
    assert np.isfinite(solver.energy().elastic)
