"""Cases of the field alone: laws of materials, walls, sleep, states, batches."""

from typing import Any

import numpy as np
from groups import BOTH, case_of
from internals import keep_solver, set_volume
from keep import Keep

import mpm

CELL, POINT = 0.01, 0.005**3
"""Size of a cell [m], and volume of a material point [m^3]."""
SAND = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)
LAWS: dict[str, Any] = {
    "sand": SAND,
    "cohesive sand": mpm.DruckerPrager(E=1e5, nu=0.3, density=1200.0, friction_angle_deg=35.0, cohesion=200.0,
                                       cone="plane_strain"),
    "mu(I)": mpm.MuIRheology(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=21.0, limit_angle_deg=33.0,
                             grain_diameter=5e-4, grain_density=2500.0),
    "clay": mpm.VonMises(E=2e5, nu=0.3, density=1500.0, yield_stress=2e3),
    "hencky": mpm.Elastic(E=1e5, nu=0.3, density=1000.0),
    "neo-hookean": mpm.Elastic(E=1e5, nu=0.3, density=1000.0, model="neo_hookean"),
    "corotated": mpm.Elastic(E=1e5, nu=0.3, density=1000.0, model="fixed_corotated"),
    "fluid": mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=0.5),
    "fluid by cells": mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=0.1, tension=False,
                                         volume_rate="cell"),
}
MIXED = mpm.Walls(lower=("periodic", "stick", "friction"), upper=("periodic", "roller", "slip"), friction=0.4)


def at(x: float, y: float, z: float) -> mpm.Pose:
    return mpm.Pose(np.array([x, y, z]), np.array([1.0, 0.0, 0.0, 0.0]))


def block(law: Any, low: tuple[float, ...] = (0.01, 0.02, 0.0), high: tuple[float, ...] = (0.07, 0.07, 0.04),
          speed: tuple[float, ...] = (0.6, 0.3, -1.0)) -> mpm.Body:
    """A block of grains at random places that is thrown."""
    positions = mpm.sample_box(low, high, CELL / 2, np.random.default_rng(0))
    return mpm.Body(law, positions, np.tile(speed, (len(positions), 1)), volume=POINT)


def box(*bodies: mpm.Body, upper: tuple[float, ...] = (0.1, 0.09, 0.1), **options: Any) -> mpm.Solver:
    return mpm.Solver(**{"grid": mpm.Grid((0, 0, 0), upper, CELL), "bodies": list(bodies),
                         "walls": mpm.Walls(friction=0.4)} | options)


def throw(keep: Keep, law: Any, **options: Any) -> None:
    """A block is thrown onto the floor and against walls: it is compressed, sheared, and parts from them."""
    with box(block(law), **options) as solver:
        for _ in range(10):
            solver.advance(8e-3)
            keep("ledger", solver.ledger)
        keep_solver(keep, solver)
        for name in ("stresses", "densities", "masses", "energy", "momentum", "diagnostics"):
            keep(name, getattr(solver, name)())


def mix(keep: Keep, *names: str) -> None:
    """Blocks of several laws are thrown beside each other."""
    bodies = [block(LAWS[name], (0.01 + 0.03 * k, 0.02, 0.0), (0.03 + 0.03 * k, 0.07, 0.03))
              for k, name in enumerate(names)]
    with box(*bodies, upper=(0.2, 0.09, 0.1)) as solver:
        solver.advance(0.05)
        keep_solver(keep, solver)


def lie(keep: Keep) -> None:
    """A bed that begins under its own stress, is turned, and gets other numbers."""
    positions = mpm.sample_box((0.0, 0.0, 0.0), (0.1, 0.09, 0.04), CELL / 2)
    stress = mpm.geostatic_stress(positions, POINT, SAND)
    keep("stress", stress)
    with box(mpm.Body(SAND, positions, volume=POINT, stress=stress)) as solver:
        solver.advance(0.02)
        keep_solver(keep, solver)
        solver.set_gravity(np.array([5.0, 0.0, -8.0]))
        solver.set_material(0, mpm.DruckerPrager(E=1.2e5, nu=0.25, density=1300.0, friction_angle_deg=25.0))
        set_volume(solver, 0, 1.1e-7)
        solver.advance(0.04)
        keep_solver(keep, solver)


def push(keep: Keep) -> None:
    """Every particle has an acceleration of its own."""
    body = block(SAND)
    pull = np.random.default_rng(1).normal(0.0, 3.0, body.positions.shape)
    with box(body, body_acceleration=pull) as solver:
        solver.advance(0.03)
        solver.set_body_acceleration(-pull)
        solver.advance(0.03)
        keep_solver(keep, solver)


def fall_asleep(keep: Keep, sleep: bool | float) -> None:
    """A bed comes to rest, and a ball wakes it."""
    ball = mpm.Collider(mpm.Sdf.sphere(0.015), friction=0.3, pose=at(0.05, 0.045, 0.08))
    positions = mpm.sample_box((0.0, 0.0, 0.0), (0.1, 0.09, 0.03), CELL / 2)
    with box(mpm.Body(SAND, positions, volume=POINT), colliders=[ball], sleep=sleep) as solver:
        for _ in range(25):
            solver.advance(0.02)
            keep("awake", solver.awake)
        keep_solver(keep, solver)
        for k in range(10):
            solver.set_collider_motion(0, at(0.05, 0.045, 0.05 - 0.002 * k), at(0.05, 0.045, 0.048 - 0.002 * k),
                                       jump=k == 0)
            solver.advance(0.01)
            keep("awake", solver.awake)
        keep_solver(keep, solver)


def come_back(keep: Keep) -> None:
    """States are loaded and checkpoints restored, and the solver goes on from them."""
    with box(block(SAND)) as solver:
        solver.advance(0.02)
        state = solver.state()
        solver.store_checkpoint()
        for _ in range(2):
            solver.advance(0.02)
            keep_solver(keep, solver, "after")
            solver.restore_checkpoint()
        solver.advance(0.03)
        solver.load(state)
        solver.advance(0.02)
        keep_solver(keep, solver, "after")


def batch(keep: Keep) -> None:
    """Three environments with a moving box, other materials and frictions, watched by a counter and a sample."""
    tool = mpm.Collider(mpm.Sdf.box((0.02, 0.02, 0.01)), friction=0.2, pose=at(0.05, 0.045, 0.06))
    with box(block(SAND), colliders=[tool]) as solver:
        chosen = np.arange(0, len(solver.positions()), 3)
        counter = mpm.RegionCounter(solver, chosen, point=np.array([0.05, 0.05, 0.0]), weights=np.ones(3), index=0,
                                    reach=0.01, per_particle=True, region=mpm.Region((0.05, 0.05, 0), (0.03, 0.03, 9)),
                                    bounds=mpm.Region((0.05, 0.05, 0.05), (0.04, 9, 9)),
                                    inner=mpm.Region((0, 0, 0.02), (0.03, 0.03, 0.03)))
        solver.attach(counter, mpm.Sample(solver, chosen))
        many, start = mpm.Batch(solver, 3, readings=2), solver.state()
        for e in range(3):
            many.set_friction(e, 0, 0.1 * e)
            many.set_volume(e, 0, (1.0 - 0.1 * e) * POINT)
            keep("counts", many.load(e, start))
        for k in range(8):
            for e in range(3):
                z = 0.06 - 0.002 * (e + 1) * k
                many.set_collider_motion(e, 0, at(0.05, 0.045, z), at(0.05, 0.045, z - 0.002 * (e + 1)))
            keep("counts", many.advance(np.full(3, 6e-3), np.full(3, 2)))
        for e in range(3):
            keep("sampled", many.sampled(e))
            many.select(e)
            keep_solver(keep, solver)


CASES = [
    case_of("law/sand", throw, SAND, usual="f32 f64 ieee threads"),
    case_of("law/sand f32", throw, SAND, precision="f32", more="threads"),
    case_of("law/cohesive sand", throw, LAWS["cohesive sand"], usual=BOTH),
    case_of("law/fluid by cells", throw, LAWS["fluid by cells"], usual="f64", more="f32"),
    case_of("law/clay", throw, LAWS["clay"], more="f32 f64 ieee"),
    *(case_of(f"law/{name}", throw, LAWS[name], more=BOTH)
      for name in ("mu(I)", "hencky", "neo-hookean", "corotated", "fluid")),
    case_of("law/solids", mix, "clay", "hencky", "neo-hookean", "corotated", "mu(I)", usual="f32"),
    case_of("law/mixture", mix, "sand", "clay", "fluid", usual=BOTH, more="ieee threads"),
    case_of("walls/mixed", throw, SAND, walls=MIXED, usual="f64", more="f32"),
    *(case_of(f"walls/{name}", throw, SAND, walls=mpm.Walls.all(name), more=BOTH)
      for name in ("slip", "stick", "roller")),
    *(case_of(f"integrator/{name}", throw, SAND, integrator=name, more="f32") for name in ("series", "exact")),
    case_of("strides/none", throw, SAND, transfer_interval=0.0, more=BOTH),
    case_of("precision/f64", throw, SAND, precision="f64", more="f32"),
    case_of("precision/f32", throw, SAND, precision="f32", more="f64"),
    case_of("bed", lie, usual="f32", more="f64"),
    case_of("acceleration", push, usual="f64", more="f32"),
    case_of("sleep/on", fall_asleep, True, usual="f32", more="f64 ieee threads"),
    case_of("sleep/off", fall_asleep, False, more="f64"),
    case_of("sleep/factor", fall_asleep, 3.0, more="f64"),
    case_of("state", come_back, usual="f32", more="f64"),
    case_of("batch", batch, usual="f64", more="f32"),
]
