"""Advances one block of sand with and without features that never act; prints whether every bit agrees: "together", all
of them in one scene, or "apart", a scene each. Run as a process of its own: bits are compared in double precision with
IEEE order, which the backend fixes for good."""

import json
import sys
from dataclasses import replace

import numpy as np
import trimesh

import mpm

CELL, DT = 0.02, 2e-4  # [m], [s]
FAR = mpm.Pose(np.array([0.42, 0.42, 0.42]), np.array([1.0, 0.0, 0.0, 0.0]))


def state(colliders: list[mpm.Collider], bodies: int = 1, transfer_interval: float = 10 * DT,
          accelerated: bool = False, sleep: bool = False) -> dict[str, np.ndarray]:
    """State of the sand after 0.03 s; a second body lies far from it.
    accelerated: every grain by nothing. sleep: grains could sleep, but none is at rest."""
    sand = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
    positions = mpm.sample_box((0, 0, 0), (0.1, 0.1, 0.1), CELL / 2, np.random.default_rng(0))
    listed = [mpm.Body(sand, positions, volume=1e-6)]
    if bodies == 2:
        drop = mpm.sample_box((0.4, 0.02, 0.0), (0.44, 0.06, 0.04), CELL / 2)
        listed.append(mpm.Body(mpm.NewtonianFluid(bulk_modulus=1e5, density=1000.0), drop, volume=1e-6))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.5, 0.5, 0.5), CELL), bodies=listed, colliders=colliders, dt=DT,
                        transfer_interval=transfer_interval, sleep=sleep,
                        body_acceleration=np.zeros((sum(len(b.positions) for b in listed), 3)) if accelerated else None)
    for index in solver.features.mobile:
        solver.set_collider_mobility(index, np.zeros((6, 6)), np.zeros(6))
    solver.advance(0.03)
    return {name: solver.particles.read(fields)[: len(positions)] for name, fields in
            solver.particles.named_fields().items() if name not in ("j", "side", "rest", "rest_place")}


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return all(bool((one[name] == other[name]).all()) for name in one)


def main() -> int:
    mpm.init(precision="f64", fast_math=False)
    plain = state([])
    ball = mpm.Sdf.sphere(0.03)
    moving, mobile = mpm.Collider(ball, pose=FAR), mpm.Collider(ball, pose=FAR, mobile=True)
    static = mpm.Collider(ball, pose=FAR, static=True)
    shell = mpm.Collider(mpm.Shell.from_mesh(trimesh.creation.icosphere(3, 0.03), 1e-3), pose=FAR)
    holes = mpm.Orifice(np.array([[0.03, 0.0, 0.0], [0.0, 0.0, -0.03]]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
                        diameter=4e-3, grain_diameter=4e-4)
    shaker = replace(shell, orifices=[holes])
    if sys.argv[1] == "together":
        agree = {"all": same(plain, state([moving, mobile, static, shell], bodies=2, accelerated=True))}
    else:
        scenes = {"moving collider": state([moving]), "mobile collider": state([mobile]),
                  "static collider": state([static]), "second body": state([], bodies=2), "shell": state([shell]),
                  "orifice": state([shaker]), "body acceleration": state([], accelerated=True),
                  "sleep": state([], sleep=True)}
        agree = {name: same(plain, other) for name, other in scenes.items()}
        agree["stride"] = same(state([], transfer_interval=0.0), state([], transfer_interval=1.5 * DT))
    print(json.dumps(agree))
    return 0


if __name__ == "__main__":
    sys.exit(main())
