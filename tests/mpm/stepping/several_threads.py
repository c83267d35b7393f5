"""A scene advanced by several threads and by one, in a process of its own: a line of JSON on standard output.

`python several_threads.py elastic|fluid`: two threads of the CPU, elastic in strides; with `cuda`: a GPU;
with `atomics`: what is compiled for a GPU, on the CPU. `elastic` alone also prints what only one thread does.
"""

import json
import sys
from dataclasses import replace

import numpy as np

import mpm
from mpm import backend
from mpm.stepping.serial import SerialStepper

CELL = 0.02


def scene(interval: float | None, material: str) -> mpm.Solver:
    """Sand and a second body that fall on a floor, a post and a moving ball; too few grains to fill the last packs."""
    spacing = CELL / 2
    low = mpm.sample_box((0.03, 0.03, 0.0), (0.17, 0.15, 0.08), spacing, np.random.default_rng(3))[:-3]
    high = mpm.sample_box((0.06, 0.04, 0.1), (0.14, 0.12, 0.14), spacing, np.random.default_rng(4))[:-1]
    sand = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    other = {"fluid": mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=1.0),
             "elastic": mpm.Elastic(E=1e5, nu=0.3, density=1000.0)}[material]
    bodies = [mpm.Body(sand, low, volume=spacing**3),
              mpm.Body(other, high, np.tile([0.3, 0.1, -1.0], (len(high), 1)), volume=spacing**3)]
    post = mpm.Collider(mpm.Sdf.sphere(0.03), friction=0.4, pose=at(0.15, 0.1, 0.02), static=True)
    ball = mpm.Collider(mpm.Sdf.sphere(0.035), friction=0.3, pose=at(0.02, 0.08, 0.06))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.24, 0.2, 0.24), CELL), bodies=bodies, colliders=[post, ball],
                      precision="f64", transfer_interval=interval)


def at(x: float, y: float, z: float) -> mpm.Pose:
    """Return a pose at a place, not rotated."""
    return mpm.Pose(np.array([x, y, z]), np.array([1.0, 0.0, 0.0, 0.0]))


def attach_counter(solver: mpm.Solver) -> mpm.Solver:
    """Attach a counter of every second particle; return the solver."""
    every = np.arange(0, len(solver.positions()), 2)
    solver.attach(mpm.RegionCounter(solver, every, point=np.array([0.1, 0.1, 0.0]), weights=np.ones(3), index=1,
                            region=mpm.Region((0.1, 0.1, 0.0), (0.05, 0.05, 9.0)),
                            inner=mpm.Region((0, 0, 0), (0.1,) * 3),
                            bounds=mpm.Region((0.1, 0.1, 0.1), (0.07, 9.0, 9.0))))
    return solver


def run(solver: mpm.Solver, advances: int = 20) -> dict[str, np.ndarray]:
    """Advance a few times by 2 ms; return state, readings, the ledger's sum, and its gap to the particles' momentum."""
    before, ledger, read = solver.momentum(), np.zeros(solver.ledger.shape), []
    for k in range(advances):
        solver.set_collider_motion(1, at(0.02 + 0.002 * k, 0.08, 0.06), at(0.02 + 0.002 * (k + 1), 0.08, 0.06))
        read += [counts[:6] for counts in solver.advance(2e-3, readings=2)]
        ledger += solver.ledger
    after = solver.momentum_after_advance()
    gap = np.concatenate([after.linear - before.linear, after.angular - before.angular]) - ledger.sum(0)
    return {**solver.state(), "ledger": ledger, "gap": gap, "read": np.array(read, float)}


def compare(interval: float | None, material: str) -> dict[str, float | bool]:
    """Compare several threads with one."""
    solver = scene(interval, material)
    start = solver.state()
    attach_counter(solver)
    first = run(solver)
    solver.load(start)
    second = run(solver)
    alone = run(attach_counter(make_serial(scene(interval, material))))
    state = [name for name in start if name not in ("poses", "time", "steps") and start[name].size]
    return {"shared": not solver.features.serial,
            "same_bits": all(np.array_equal(first[name], second[name]) for name in state),
            "moved": float(np.abs(first["x"] - start["x"]).max()),
            "off_one_thread": max(off(first[name], alone[name]) for name in state),
            "ledger_off": off(first["ledger"], alone["ledger"]),
            "readings_off": off(first["read"], alone["read"]),
            "post_pushed": float(np.abs(first["ledger"][2]).max()),
            "ball_pushed": float(np.abs(first["ledger"][3]).max()),
            "gap": float(np.abs(first["gap"]).max() / np.abs(first["ledger"]).max())}


def make_serial(solver: mpm.Solver) -> mpm.Solver:
    """Give a solver the kernel of one thread; return it."""
    solver.fields.grid.lists = True
    solver.features = replace(solver.features, serial=True)
    fields = replace(solver.fields, features=solver.features, parts=0, scatter_target=solver.fields.grid.nodes)
    solver.assembly.shared["fields"] = fields
    solver.stepper = SerialStepper(solver.fields)
    return solver


def off(values: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(values - expected).max() / np.abs(expected).max())


def refusal(make) -> str:  # noqa: ANN001  (a callable)
    """Return the message of the InvalidValue that a call raises."""
    try:
        make()
    except mpm.InvalidValue as error:
        return str(error)
    return "nothing"


def refusals() -> list[bool | str]:
    """Return whether periodic sides have one thread, and the messages of a batch and a rollout of several."""
    solver = scene(None, "elastic")
    mpm.init()  # as robosim's environments do: the present session serves
    around = mpm.Solver(grid=solver.grid, bodies=solver.bodies,
                        walls=mpm.Walls(lower=("periodic",) * 2 + ("slip",), upper=("periodic",) * 2 + ("slip",)))
    return [around.features.serial, refusal(lambda: mpm.Batch(solver, 2)), refusal(lambda: mpm.Rollout(solver, 3))]


if __name__ == "__main__":
    on_gpu = "cuda" in sys.argv
    mpm.init(arch="cuda" if on_gpu else "cpu", threads=1 if on_gpu else 2, fast_math=False)
    if "atomics" in sys.argv:
        backend._session = backend._session._replace(arch="cuda")
    found = compare(0.0, "fluid") if "fluid" in sys.argv else compare(None, "elastic")
    print(json.dumps(found | ({"refusals": refusals()} if sys.argv[1:] == ["elastic"] else {})))
