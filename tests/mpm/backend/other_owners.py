"""Solvers used in forked processes and in several threads, in a process of its own: a line of JSON on standard output.
`python other_owners.py fork|fork_in_thread|thread|init_in_thread`."""

import hashlib
import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh

import mpm

SAND = mpm.DruckerPrager(E=1e5, nu=0.3, density=1500.0, friction_angle_deg=30.0)
CLAY = replace(SAND, friction_angle_deg=10.0)
POST = mpm.Sdf.from_mesh(trimesh.creation.box((0.06, 0.06, 0.06)), spacing=0.01)
"""A shape whose lattice is a field: made once, used by solvers of several processes."""
DURATION, PATIENCE = 5e-3, 240
"""Time [s] that is advanced, and time [s] after which a forked process that waits for ever is ended."""


def scene() -> mpm.Solver:
    """Sand that falls on a box."""
    pose = mpm.Pose(np.array([0.1, 0.1, 0.03]), np.array([1.0, 0.0, 0.0, 0.0]))
    post = mpm.Collider(POST, friction=0.4, pose=pose, static=True)
    body = mpm.Body(SAND, mpm.sample_box((0.08, 0.08, 0.07), (0.12, 0.12, 0.09), 0.01), volume=1e-6)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[body], colliders=[post])


def settings(solver: mpm.Solver) -> str:
    """What a solver's refused setters must leave as it was."""
    return f"{solver.gravity} {solver.colliders[0].friction} {solver.bodies[0].material}"


def bits(solver: mpm.Solver) -> str:
    return hashlib.sha256(solver.positions().tobytes() + solver.velocities().tobytes()).hexdigest()


def advanced() -> str:
    solver = scene()
    solver.advance(DURATION)
    return bits(solver)


def outcome(use: Callable[[], Any]) -> str:
    """The name and the message of the error of a use, or what it returned."""
    try:
        return str(use())
    except mpm.MpmError as error:
        return f"{type(error).__name__}: {error}"


def uses(solver: mpm.Solver, state: dict[str, Any], others: dict[str, Callable[[], Any]]) -> dict[str, str]:
    """What comes of each use of a solver."""
    each = {"advance": lambda: solver.advance(DURATION), "compile": solver.compile, "positions": solver.positions,
            "velocities": solver.velocities, "energy": solver.energy, "state": solver.state,
            "load": lambda: solver.load(state), "set_gravity": lambda: solver.set_gravity(np.zeros(3)),
            "set_friction": lambda: solver.set_friction(0, 0.1), "set_material": lambda: solver.set_material(0, CLAY),
            "store_checkpoint": solver.store_checkpoint, "Batch": lambda: mpm.Batch(solver, 2)}
    return {name: outcome(use) for name, use in (each | others).items()}


def in_child(do: Callable[[], Any]) -> tuple[Any, int]:
    """Return what a function returns in a forked process, which ends as a script does, and the process's status."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(PATIENCE)
        os.write(writer, json.dumps(do()).encode())
        sys.exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        text = pipe.read()
    return json.loads(text or "null"), os.waitpid(child, 0)[1]


def in_thread(do: Callable[[], Any]) -> Any:
    results: list[Any] = []
    thread = threading.Thread(target=lambda: results.append(do()), name="second")
    thread.start()
    thread.join()
    return results[0]


def fork() -> dict[str, Any]:
    """Solvers of a forked process, and those of the one that it was forked from."""
    solver = scene()
    state = solver.state()
    batch = mpm.Batch(solver, 1)
    others: dict[str, Callable[[], Any]] = {"Batch.load": lambda: batch.load(0, state)}

    def child() -> dict[str, Any]:
        before = uses(solver, state, others)
        own = advanced()
        return {"refused": [before, uses(solver, state, others)], "own": own, "grandchild": in_child(advanced)}

    result, status = in_child(child)
    unused = in_child(lambda: 0)
    solver.load(state)
    solver.advance(DURATION)
    return {"child": result, "status": status, "unused": unused, "parent": bits(solver)}


def fork_in_thread() -> dict[str, Any]:
    """A process forked by another thread than the one that uses the field."""
    solver = scene()
    child, status = in_thread(lambda: in_child(lambda: outcome(scene)))
    return {"child": child, "status": status, "parent": outcome(solver.energy)}


def thread() -> dict[str, Any]:
    """A second thread that uses the field first, and later a solver of the main one."""
    first = in_thread(lambda: outcome(scene))
    solver = scene()
    state = solver.state()
    before = bits(solver), settings(solver)
    refused = in_thread(lambda: uses(solver, state, {"Solver": scene}))
    return {"first": first, "refused": refused, "before": before, "after": (bits(solver), settings(solver))}


def init_in_thread() -> dict[str, Any]:
    """A second thread that asks for the field, and the main one after it."""
    def own() -> str:
        mpm.init()
        return outcome(scene)

    return {"own": in_thread(own), "main": [outcome(scene), outcome(mpm.init)]}


if __name__ == "__main__":
    print(json.dumps({"fork": fork, "fork_in_thread": fork_in_thread, "thread": thread,
                      "init_in_thread": init_in_thread}[sys.argv[1]]()))
