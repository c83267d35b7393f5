"""Bed of sand or of an elastic solid, on which light bodies lie and slide."""

import numpy as np

import mpm
from mpm.scene.scene import Contact
from robosim.studies.verification.cases.rigid_body import G

ELASTIC_E = 5e5
"""Young's modulus [Pa] of the elastic bed."""


def build_bed(kind: str, size: tuple[float, float, float], cell: float, *, headroom: float, contact: Contact,
              gravity: tuple[float, float, float] = (0.0, 0.0, -G), precision: str = "f32") -> mpm.Solver:
    """Build a bed that sticks to its walls.

    kind: "sand" or "elastic", which bears a body but not itself; size, cell, headroom above the bed [m].
    """
    length, width, top = size
    positions = mpm.sample_box((0.0, 0.0, 0.0), size, cell / 2)
    elastic = kind == "elastic"
    law = mpm.Elastic(E=ELASTIC_E, nu=0.0, density=1000.0) if elastic else \
        mpm.DruckerPrager(E=3e5, nu=0.2, density=1500.0, friction_angle_deg=40.0)
    return mpm.Solver(
        grid=mpm.Grid((0.0, 0.0, 0.0), (length, width, top + headroom), cell), gravity=gravity,
        bodies=[mpm.Body(law, positions, volume=length * width * top / len(positions))], walls=mpm.Walls.all("stick"),
        contact=contact, precision=precision,
        body_acceleration=np.tile(-np.array(gravity), (len(positions), 1)) if elastic else None)
