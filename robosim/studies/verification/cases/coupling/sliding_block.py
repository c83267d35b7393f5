"""Rigid block that slides down an incline of sand or of elastic material, or along a level bed without friction.

Measured: the relative error of its acceleration, on a level bed its drag over its weight, and how far it sits above the
bed. Reference: Coulomb's law, g (sin - mu cos), for a block that lies along the incline. A heavy one tips forward by a
degree or more, as the bed gives way at its front, and slides on a steeper face: the error `on_face` is that for the
face as it lies. The block is laid flush, or lowered from above. While it lies on the bed, nothing meets its sides.
"""

import math

import mujoco
import numpy as np

import mpm
from mpm.scene.features import Contact
from robosim.coupling.plugin import GranularPlugin
from robosim.studies.verification.cases.claims import Within
from robosim.studies.verification.cases.record import Record, TimedSolver

NAME = "sliding_block"
SOURCE = "Coulomb's law: a = g (sin - mu cos)"
BANDS = {"acceleration": 0.05, "on_face": 0.05, "frictionless": 0.03, "drag": 0.03, "gap": 0.15}
"""Relative error of the acceleration with friction, by the incline and by the block's lower face, and without friction;
drag of a level block without friction over its weight; and cells between block and bed, which gives way under a heavy
one."""
BEDS, STARTS, CELLS, MASSES = ("elastic", "sand"), ("flush", "lowered"), (0.008, 0.005, 0.004), (0.1, 0.25, 2.5, 5.0)
"""Cells [m], masses [kg]."""
LEVEL = {"bed": "sand", "incline_deg": 0.0, "friction": 0.0}
SWEEP = [*({"bed": b, "start": s, "cell": c, "mass": m} for b in BEDS for s in STARTS for c in CELLS for m in MASSES),
         *({"bed": b, "start": s, "cell": c, "friction": 0.0} for b in BEDS for s in STARTS for c in CELLS),
         *({**LEVEL, "start": s, "cell": c, "mass": m} for s in STARTS for c in CELLS for m in (0.25, 5.0)),
         *({"bed": b, "mass": 0.001, "start": s} for b in BEDS for s in STARTS),
         *({"bed": b, "coupling": "lagged"} for b in BEDS), *({"bed": b, "contact": "near"} for b in BEDS),
         {"bed": "sand", "offset_cells": 0.3}, {"bed": "sand", "offset_cells": 0.6}]
"""Choices of the runs in a whole report."""
QUICK_SWEEP = [{"bed": "sand", "start": "lowered"}, {"bed": "elastic", "friction": 0.0}, {**LEVEL, "start": "lowered"}]
MAIN_ERROR, RESOLUTION = "acceleration", "cell"
TOUCHING = {"contact": "touching"}
CLAIMS = (*(Within("acceleration", BANDS["acceleration"], {**TOUCHING, "bed": b, "start": s, "cell": c})
            for b in BEDS for s in STARTS for c in CELLS),
          *(Within("on_face", BANDS["on_face"], {**TOUCHING, "bed": b}) for b in BEDS),
          Within("acceleration", BANDS["frictionless"], {**TOUCHING, "friction": 0.0}),
          Within("drag", BANDS["drag"], TOUCHING),
          *(Within("gap", BANDS["gap"], {**TOUCHING, "start": "lowered", "cell": c}) for c in CELLS))
INCLINE_DEG, G = 27.0, 9.81
BED = (0.32, 0.16, 0.032)
SIDE, HEIGHT = 0.096, 0.03
"""Of the block [m], which is so large that sand bears 5 kg."""
HOST_STEP, HELD, SLID = 0.002, 0.15, 0.2
"""[s]: of MuJoCo; how long the block is kept from sliding; and how long it slides."""
START, SPEED = 0.08, 0.2
"""Where the block's middle lies at first [m], and how fast it begins to slide on a level bed [m/s]."""

BLOCK = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast" gravity="{gx} 0 {gz}"/>
  <worldbody>
    <body name="block" pos="{x} {y} {z}">
      <freejoint/>
      <geom type="box" size="{half} {half} {half_height}" mass="{mass}" friction="{friction}"/>
    </body>
  </worldbody>
</mujoco>
"""


def measure(*, bed: str = "sand", start: str = "flush", mass: float = 0.25, friction: float = 0.3, cell: float = 0.008,
            coupling: str = "mobility", offset_cells: float = 0.0, contact: Contact = "touching",
            incline_deg: float = INCLINE_DEG, precision: str = "f32") -> Record:
    """Run the case; return the error of the acceleration, or with incline_deg 0 the drag.

    bed: "sand" or "elastic". start: "flush" on the bed, or "lowered" from 1.5 cells above it. mass [kg]; cell [m];
    offset_cells: of the bed's top from a plane of nodes. contact: see `mpm.Solver`. incline_deg: the block slides down
    by itself, or with 0 begins with `SPEED`; the drag is then over its weight, less that of its friction.
    """
    angle = math.radians(incline_deg)
    gravity = np.array([G * math.sin(angle), 0.0, -G * math.cos(angle)])
    top = BED[2] + offset_cells * cell
    positions = mpm.sample_box((0.0, 0.0, 0.0), (*BED[:2], top), cell / 2)
    elastic = bed == "elastic"
    law = mpm.Elastic(E=5e5, nu=0.0, density=1000.0) if elastic else \
        mpm.DruckerPrager(E=3e5, nu=0.2, density=1500.0, friction_angle_deg=40.0)
    solver = mpm.Solver(
        grid=mpm.Grid((0.0, 0.0, 0.0), (*BED[:2], top + 0.1), cell), precision=precision, gravity=tuple(gravity),
        bodies=[mpm.Body(law, positions, volume=BED[0] * BED[1] * top / len(positions))], walls=mpm.Walls.all("stick"),
        contact=contact,
        # an elastic bed bears the block alone, not itself
        body_acceleration=np.tile(-gravity, (len(positions), 1)) if elastic else None)
    height = top + HEIGHT / 2 + (1.5 * cell if start == "lowered" else 0.0)
    model = mujoco.MjModel.from_xml_string(BLOCK.format(
        host_step=HOST_STEP, gx=gravity[0], gz=gravity[2], x=START, y=BED[1] / 2, z=height, half=SIDE / 2,
        half_height=HEIGHT / 2, mass=mass, friction=friction))
    data = mujoco.MjData(model)
    plugin = GranularPlugin(model, data, solver, bodies={"block": None}, coupling=coupling)  # pyright: ignore[reportArgumentType]
    timed, speeds, gaps, shares, pitches, is_released = TimedSolver(solver), [], [], [], [], False
    is_top = positions[:, 2] > top - 0.5 * cell
    for step in range(round((HELD + SLID) / HOST_STEP)):
        if step * HOST_STEP < HELD:
            data.qvel[[0, 3, 4, 5]] = 0.0
            if step % 5 == 0:
                state = solver.state()
                state["v"] *= 0.8
                solver.load(state)
                data.qvel *= 0.8
        elif incline_deg == 0.0 and not is_released:
            data.qvel[0], is_released = SPEED, True
        timed.run(plugin.step)
        if (step - 10) * HOST_STEP > HELD:
            speeds.append(data.qvel[0])
            gaps.append(_gap(data.qpos, solver.positions()[is_top], top - positions[:, 2].max(), cell))
            shares.append(plugin.wrench("block").force)
            pitches.append(2.0 * math.asin(data.qpos[5]))
    acceleration = np.polyfit(HOST_STEP * np.arange(len(speeds)), speeds, 1)[0]
    exact = G * (math.sin(angle) - friction * math.cos(angle))
    along, _, normal = np.mean(shares, axis=0)
    choices = {"bed": bed, "start": start, "mass": mass, "friction": friction, "cell": cell, "coupling": coupling,
               "offset_cells": offset_cells, "contact": contact, "incline_deg": incline_deg, "precision": precision}
    if incline_deg == 0.0:
        errors = {"drag": (exact - acceleration) / G}
    else:
        # the bed's force is at the angle of friction to the normal of the face, which has tipped by the pitch
        tipped = G * (math.sin(angle) - math.cos(angle) * np.tan(math.atan(friction) - np.array(pitches)).mean())
        errors = {"acceleration": acceleration / exact - 1, "on_face": acceleration / tipped - 1}
    errors["gap"] = np.mean(gaps)
    return timed.record(NAME, choices, errors, tangential_share=float(-along / normal),
                        pitch_deg=math.degrees(pitches[-1]), mean_pitch_deg=math.degrees(np.mean(pitches)))


def _gap(place: np.ndarray, grains: np.ndarray, half: float, cell: float) -> float:
    """Return the cells between the block and the bed under it, whose topmost grains (n, 3) reach half [m] higher."""
    is_below = (np.abs(grains[:, :2] - place[:2]) < SIDE / 2 - 2 * cell).all(1)
    return float((place[2] - HEIGHT / 2 - grains[is_below, 2].mean() - half) / cell)
