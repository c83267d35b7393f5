"""Sleeping particles against the same scene awake."""

from collections.abc import Callable

import numpy as np

import mpm
from robosim.studies.verification.cases.beds import UPRIGHT, fill_box
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.granular.collapse_profile import Collapse, build

SAND = mpm.DruckerPrager(E=1.5e5, nu=0.2, density=1500.0, friction_angle_deg=30.0)
CELL, STEP = 0.01, 0.01
SPEED, STROKE, BALL, DEPTH = 0.1, 0.12, 0.015, 0.02
"""Of the plough: speed [m/s], length, radius and depth below the surface [m]."""
BED = (0.2, 0.08, 0.04)
MIDDLE = np.array([0.08, 0.08, -CELL])
"""Of the plate that vibrates, at rest."""


class Watch:
    """Advances a solver, and sums what the ledger lacks and who is awake; has a scene's readings at its end."""

    def __init__(self, solver: mpm.Solver) -> None:
        self.timed, self.solver = TimedSolver(solver), solver
        self.lacking, self.exchanged, self.shares = 0.0, 0.0, []
        self.readings = dict[str, float]()

    def advance(self, duration: float) -> None:
        """Advance by `duration` [s]."""
        before = np.concatenate(self.solver.momentum_after_advance())
        self.timed.advance(duration)
        change = np.concatenate(self.solver.momentum_after_advance()) - before
        given = self.solver.ledger.sum(0) + np.concatenate(self.solver.sleepers_impulse)
        self.lacking = max(self.lacking, float(np.abs(change - given).max()))
        self.exchanged = max(self.exchanged, float(np.abs(self.solver.ledger).max()))
        self.shares.append(float(self.solver.awake.mean()))

    def read(self, **readings: float) -> "Watch":
        """Take over readings; return this."""
        self.readings = readings
        return self


def collapse(sleep: float, pause: float) -> Watch:
    """Release a column; measure its deposit after 1.5 s: the radius [m] of 99 % of the grains, and the crest [m]."""
    watch = Watch(build(Collapse(cells=12, law="drucker_prager", E=2e4, courant=0.55), sleep))
    for _ in range(150):
        watch.advance(STEP)
    positions = watch.solver.positions()
    radii = np.hypot(*positions[:, :2].T)
    return watch.read(rim=float(np.quantile(radii, 0.99)),
                      crest=float(np.quantile(positions[radii < 0.02, 2], 0.99)))


def plough(sleep: float, pause: float) -> Watch:
    """Draw a ball through a bed and, after a pause above it, back through its furrow; measure the mean drag of both."""
    low, high = BED[2] - DEPTH + BALL, BED[2] + 4 * BALL
    left, right = 0.5 * (BED[0] - STROKE), 0.5 * (BED[0] + STROKE)
    ball = mpm.Collider(mpm.Sdf.sphere(BALL), friction=0.3,
                        pose=mpm.Pose(np.array([left, 0.5 * BED[1], high]), UPRIGHT))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (BED[0], BED[1], 0.16), CELL), walls=mpm.Walls(friction=0.5),
                        bodies=[fill_box(SAND, (0, 0, 0), BED, CELL)], colliders=[ball], sleep=sleep or False,
                        precision="f32")
    watch, drags = Watch(solver), []

    def carry(x: float, z: float, seconds: float) -> float:
        """Carry the ball to a place; return the mean force along x [N]."""
        begin = solver.collider_pose(0).position
        steps, impulse = max(1, round(seconds / STEP)), 0.0
        for k in range(steps):
            ends = [begin + (np.array([x, begin[1], z]) - begin) * (part / steps) for part in (k, k + 1)]
            solver.set_collider_motion(0, *[mpm.Pose(end, UPRIGHT) for end in ends])
            watch.advance(STEP)
            impulse += float(solver.collider_impulse(0).force[0])
        return impulse / (steps * STEP)

    carry(left, high, 0.3)
    for begin, end in ((left, right), (right, left)):
        carry(begin, low, (high - low) / SPEED)
        drags.append(abs(carry(end, low, STROKE / SPEED)))
        carry(end, high, (high - low) / SPEED)
        carry(end, high, pause if end == right else STEP)
    return watch.read(**{"first force": drags[0], "second force": drags[1]})


def creep(sleep: float, pause: float) -> Watch:
    """Let a block slide on a floor without friction for 2 s; measure its path."""
    block = mpm.sample_box((0.03, 0.02, 0.0), (0.07, 0.06, 0.02), CELL / 2)
    body = mpm.Body(mpm.Elastic(E=1.5e5, nu=0.2, density=1500.0), block, volume=(CELL / 2) ** 3,
                    velocities=np.tile([1e-4, 0.0, 0.0], (len(block), 1)))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.12, 0.08, 0.06), CELL), walls=mpm.Walls.all("slip"), bodies=[body],
                        sleep=sleep or False, precision="f64")
    watch = Watch(solver)
    for _ in range(200):
        watch.advance(STEP)
    return watch.read(path=float((solver.positions() - block)[:, 0].mean()))


def vibration(sleep: float, pause: float) -> Watch:
    """Shake a heap on a plate by 0.1 mm at 40 Hz for a second; measure its height."""
    plate = mpm.Collider(mpm.Sdf.box((0.09, 0.09, CELL)), friction=0.5, pose=mpm.Pose(MIDDLE, UPRIGHT))
    heap = fill_box(SAND, (0.05, 0.05, 0.0), (0.11, 0.11, 0.04), CELL)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, -2 * CELL), (0.16, 0.16, 0.1), CELL), colliders=[plate],
                        bodies=[heap], sleep=sleep or False, precision="f32")
    watch = Watch(solver)
    for k in range(500):
        heights = [1e-4 * np.sin(2 * np.pi * 40 * time) for time in (2e-3 * k, 2e-3 * (k + 1))]
        solver.set_collider_motion(0, *[mpm.Pose(MIDDLE + [0.0, 0.0, z], UPRIGHT) for z in heights])
        watch.advance(2e-3)
    return watch.read(height=float(np.quantile(solver.positions()[:, 2], 0.9)))


RUNS: dict[str, Callable[[float, float], Watch]] = {
    "collapse": collapse, "plough": plough, "creep": creep, "vibration": vibration}


@case(
    source="the same scene without sleeping",
    sweep=grid(scene=tuple(RUNS), sleep=(0.1, 1.0, 4.0)),
    quick=[{"scene": "collapse"}, {"scene": "plough", "pause": 1.0}],
    # momentum that the ledger lacks, of what was exchanged, in single precision
    expectations=(*(Within(name, high, {"scene": scene, "sleep": sleep}) for name, high, scene, sleep in (
                      ("rim", 0.01, "collapse", 1.0), ("crest", 0.01, "collapse", 1.0),
                      ("first force", 0.03, "plough", 1.0), ("second force", 0.03, "plough", 1.0),
                      ("path", 0.02, "creep", 0.1), ("height", 0.01, "vibration", 1.0))),
                  Within("unaccounted", 1e-5)),
    main_error="deposit", resolution="sleep")
def sleeping(*, scene: str = "collapse", sleep: float = 1.0, pause: float = 10.0) -> Record:
    """Sleeping particles against the same scene awake: what sleeping costs in accuracy, and what it saves.

    Scenes: a column that collapses; a ball that ploughs a bed, comes back after `pause` seconds and ploughs it again; a
    block that slides on a floor without friction at 0.1 mm/s, slower than what counts as rest at the default: it is
    frozen there, and not with a tenth of the thresholds; a heap on a plate that vibrates. The reference is run in the
    same process. Errors are relative to the reading of the scene that is awake. sleep: factor on the thresholds."""
    awake, asleep = RUNS[scene](0.0, pause), RUNS[scene](sleep, pause)
    errors = {name: asleep.readings[name] / value - 1.0 for name, value in awake.readings.items()}
    errors["unaccounted"] = asleep.lacking / asleep.exchanged
    return asleep.timed.record(errors, speedup=awake.timed.seconds / asleep.timed.seconds,
                               seconds_awake=awake.timed.seconds, awake_share=np.mean(asleep.shares),
                               **{f"{name} awake": value for name, value in awake.readings.items()})
