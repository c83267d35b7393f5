"""A scene advanced in a process of its own, which has one backend: what comes of it is written to a file.
`python several_threads.py WHERE SCENE OUT.npz [f32]`. WHERE: `one` or `two` threads of the CPU, `cuda`, `vulkan`, or
`atomics`, what is compiled for a GPU on the CPU. SCENE: `elastic` (in strides), `fluid`, `tools` or `sleep`. The file
also has what a batch and a rollout say."""

import sys
from collections.abc import Callable

import numpy as np
import trimesh

import mpm
from mpm.backend import session
from mpm.gpu import phase_loops

CELL = 0.02


def scene(name: str, precision: str) -> mpm.Solver:
    """Sand and a second body that fall on a floor, a post and a moving ball; too few grains to fill the last packs."""
    spacing = CELL / 2
    low = mpm.sample_box((0.03, 0.03, 0.0), (0.17, 0.15, 0.08), spacing, np.random.default_rng(3))[:-3]
    high = mpm.sample_box((0.06, 0.04, 0.1), (0.14, 0.12, 0.14), spacing, np.random.default_rng(4))[:-1]
    sand = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    other = {"fluid": mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0, viscosity=1.0),
             "elastic": mpm.Elastic(E=1e5, nu=0.3, density=1000.0)}.get(name, sand)
    bodies = [mpm.Body(sand, low, volume=spacing**3),
              mpm.Body(other, high, np.tile([0.3, 0.1, -1.0], (len(high), 1)), volume=spacing**3)]
    grid = mpm.Grid((0, 0, 0), (0.24, 0.2, 0.24), CELL)
    if name in ("tools", "sleep"):
        return mpm.Solver(grid=grid, bodies=bodies[: 1 if name == "sleep" else 2], colliders=tools(),
                          precision=precision, transfer_interval="strides", sleep=name == "sleep", walls=None
                          if name == "sleep" else mpm.Walls(lower=("periodic", "friction", "friction"),
                                                            upper=("periodic", "friction", "friction")))
    post = mpm.Collider(mpm.Sdf.sphere(0.03), friction=0.4, pose=at(0.15, 0.1, 0.02), static=True)
    ball = mpm.Collider(mpm.Sdf.sphere(0.035), friction=0.3, pose=at(0.02, 0.08, 0.06))
    return mpm.Solver(grid=grid, bodies=bodies, colliders=[post, ball], precision=precision,
                      transfer_interval=0.0 if name == "fluid" else None)


def tools() -> list[mpm.Collider]:
    """A bowl and a ball that grains push.
    No node lies on a plane of the bowl's lattice, where rounding would choose the cell."""
    bowl = trimesh.creation.icosphere(3, 0.05)
    bowl.update_faces(bowl.triangles_center[:, 2] < 0.015)
    bowl.remove_unreferenced_vertices()
    return [mpm.Collider(mpm.Shell.from_mesh(bowl, 2e-3), friction=0.3, pose=at(0.0813, 0.0907, 0.1306), mobile=True),
            mpm.Collider(mpm.Sdf.sphere(0.025), friction=0.3, pose=at(0.172, 0.1, 0.107), mobile=True)]


def at(x: float, y: float, z: float) -> mpm.Pose:
    return mpm.Pose(np.array([x, y, z]), np.array([1.0, 0.0, 0.0, 0.0]))


def attach_counter(solver: mpm.Solver) -> None:
    every = np.arange(0, len(solver.positions()), 2)
    solver.attach(mpm.RegionCounter(solver, every, point=np.array([0.1, 0.1, 0.0]), weights=np.ones(3), index=1,
                            region=mpm.Region((0.1, 0.1, 0.0), (0.05, 0.05, 9.0)),
                            inner=mpm.Region((0, 0, 0), (0.1,) * 3),
                            bounds=mpm.Region((0.1, 0.1, 0.1), (0.07, 9.0, 9.0))))


def move(solver: mpm.Solver, k: int) -> None:
    """Hand over how the colliders move in advance k: the ball along a path, tools as grains and gravity move them."""
    for index in solver.features.mobile:
        W = np.diag([2.0] * 3 + [2000.0] * 3)
        twist = np.array([0.02, 0.0, -0.4, 0.0, 0.0, 1.0]) if k == 0 else np.concatenate(solver.collider_twist(index))
        solver.set_collider_mobility(index, W, twist + [0, 0, -9.81 * 2e-3, 0, 0, 0], twist=twist)
    if not solver.features.mobile:
        solver.set_collider_motion(1, at(0.02 + 0.002 * k, 0.08, 0.06), at(0.02 + 0.002 * (k + 1), 0.08, 0.06))


def run(solver: mpm.Solver, advances: int) -> dict[str, np.ndarray]:
    """Advance a few times by 2 ms; return state, readings, the ledger's sum, and its gap to the particles' momentum."""
    before, ledger, read = solver.momentum(), np.zeros(solver.ledger.shape), []
    for k in range(advances):
        move(solver, k)
        read += [counts[:6] for counts in solver.advance(2e-3, readings=2)]
        ledger += solver.ledger
    after = solver.momentum_after_advance()
    gap = np.concatenate([after.linear - before.linear, after.angular - before.angular]) - ledger.sum(0)
    return {**solver.state(), "ledger": ledger, "gap": gap, "read": np.array(read, float)}


def message_of(error: type[mpm.MpmError], make: Callable[[], object]) -> str:
    try:
        make()
    except error as raised:
        return str(raised)
    return "nothing"


def main(where: str, name: str, out: str) -> None:
    """Advance the scene twice from its start, and write what comes of it."""
    on_gpu = where in ("cuda", "vulkan")
    mpm.init(arch=where if on_gpu else "cpu", threads=1 if on_gpu or where == "one" else 2, fast_math=False)
    if where == "atomics":
        session._session = session._session._replace(arch="cuda")
        phase_loops.TEAM = 1  # threads of a CPU cannot wait for each other as those of a GPU
    solver = scene(name, "f32" if "f32" in sys.argv or where == "vulkan" else "f64")
    advances = 60 if name == "sleep" else 20
    start = solver.state()
    attach_counter(solver)
    first = run(solver, advances)
    solver.load(start)
    again = run(solver, advances)
    state = [key for key in start if key not in ("poses", "time", "steps") and start[key].size]
    faster = {**start, "v": start["v"].copy()}
    faster["v"][3] = 1e4
    solver.load(faster)
    diverged = message_of(mpm.SimulationDiverged, lambda: solver.advance(2e-3))
    refusals = [message_of(mpm.InvalidValue, make)
                for make in (lambda: mpm.Batch(solver, 2), lambda: mpm.Rollout(solver, 3))]
    np.savez(out, start=start["x"], serial=solver.features.serial, names=state, refusals=refusals, diverged=diverged,
             same_bits=all(np.array_equal(first[key], again[key]) for key in state), **first)


if __name__ == "__main__":
    main(*sys.argv[1:4])
