"""Arguments that can never be meant are refused by name, before anything is allocated."""

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from field_parts import UPRIGHT, at, block, sand

import mpm

NAN = float("nan")
GRID = mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.01)
SAND = sand()
BODY = block(SAND, (0.05,) * 3, (0.1,) * 3, 0.005)
SHEET = mpm.Shell.from_mesh(trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]]), 1e-3)
BALL = mpm.Sdf.sphere(0.03)


@pytest.mark.parametrize("pose", [
    at(NAN, 0, 0), mpm.Pose(np.zeros(3), np.array([1.0, NAN, 0, 0])),
    mpm.Pose(np.zeros(3), np.zeros(4)), mpm.Pose(np.zeros(2), UPRIGHT), np.eye(4), None],
    ids=["position", "nan", "zero", "plane", "matrix", "none"])
def test_a_pose_places_something(pose: Any) -> None:
    for make in (lambda: mpm.Collider(BALL, pose=pose), lambda: mpm.Sdf.union([(BALL, pose)])):
        with pytest.raises(mpm.InvalidValue, match="pose = .*accepted: finite numbers"):
            make()


@pytest.mark.parametrize(("make", "words"), [
    (lambda: mpm.Sdf.sphere(-0.03), r"Sdf.sphere: r = -0.03 m; accepted: a positive length"),
    (lambda: mpm.Sdf.sphere(NAN), "r = nan"),
    (lambda: mpm.Sdf.capsule(0.0, 0.1), "Sdf.capsule: r = 0.0"),
    (lambda: mpm.Sdf.capsule(0.1, -0.1), "h = -0.1 m; accepted: a length of 0 or more"),
    (lambda: mpm.Sdf.cylinder(0.1, 0.0), "Sdf.cylinder: h = 0.0"),
    (lambda: mpm.Sdf.box((0.1, 0.0, 0.1)), r"Sdf.box: half = \(0.1, 0.0, 0.1\) m; accepted: 3 positive lengths"),
    (lambda: mpm.Sdf.box(0.1), "accepted: 3 positive lengths"),
    (lambda: mpm.Sdf.ellipsoid((0.1, 0.1, -0.1)), "Sdf.ellipsoid: half"),
    (lambda: mpm.Sdf.plane((0, 0, 0)), "Sdf.plane: normal"),
    (lambda: mpm.Sdf.height_field(np.zeros((3, 3)), (0.1, 0.0)), "Sdf.height_field: half"),
    (lambda: mpm.Sdf.height_field(np.full((3, 3), NAN), (0.1, 0.1)), "heights have shape"),
    (lambda: mpm.Sdf.union([]), "no parts"),
    (lambda: mpm.Sdf.from_mesh(trimesh.creation.box((0.1,) * 3), spacing=0.0), "from_mesh: spacing = 0.0"),
    (lambda: mpm.sample_box((0,) * 3, (0.1,) * 3, NAN), "spacing nan"),
], ids=lambda value: value if isinstance(value, str) else "case")
def test_a_solid_has_a_size(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(mpm.InvalidValue, match=words):
        make()


USUAL: dict[Any, dict[str, Any]] = {
    mpm.Collider: {}, mpm.Solver: {"grid": GRID, "bodies": [BODY]},
    mpm.Body: {"material": SAND, "positions": np.full((2, 3), 0.1), "volume": 1e-7}}


@pytest.mark.parametrize(("kind", "given", "words"), [
    (mpm.Collider, {"sdf": SHEET, "static": True}, "static = True and a Shell.*accepted: static = False"),
    (mpm.Collider, {"sdf": trimesh.creation.box((0.1,) * 3)},
     "sdf = a Trimesh; accepted: a solid, such as mpm.Sdf.from_mesh"),
    (mpm.Solver, {"bodies": BODY}, r"bodies = a Body; accepted: a list of mpm.Body"),
    (mpm.Solver, {"bodies": mpm.Body}, r"bodies = Body \(a class\); accepted: a list"),
    (mpm.Solver, {"bodies": ["b"]}, r"bodies\[0\] = 'b'; accepted: mpm.Body"),
    (mpm.Solver, {"walls": "slip"}, r"walls = 'slip'; accepted: mpm.Walls, such as mpm.Walls.all"),
    (mpm.Solver, {"colliders": mpm.Collider(BALL)}, "colliders = a Collider; accepted: a list of mpm.Collider"),
    (mpm.Solver, {"colliders": [BALL]}, r"colliders\[0\] = a Sphere; accepted: mpm.Collider"),
    (mpm.Solver, {"grid": 0.01}, r"grid = 0.01; accepted: mpm.Grid"),
    (mpm.Solver, {"gravity": (0, 0, -9.81j)}, "gravity = .*accepted: finite numbers"),
    (mpm.Body, {"positions": np.full((2, 3), 0.1j)}, r"Body: positions = .*accepted: real numbers \[m\]"),
    (mpm.Body, {"positions": [["a", "b", "c"]]}, "Body: positions"),
    (mpm.Body, {"velocities": np.full((2, 3), NAN)}, "Body: velocities = .*accepted: finite numbers"),
    (mpm.Body, {"volume": np.inf}, "Body: volume = inf"), (mpm.Body, {"volume": 1j}, "Body: volume = 1j"),
    (mpm.Body, {"material": mpm.DruckerPrager}, r"material = DruckerPrager \(a class\)"),
], ids=lambda value: value if isinstance(value, str) else "case")
def test_parts_of_a_scene_of_other_types_or_numbers_are_refused(kind: Any, given: dict[str, Any], words: str) -> None:
    with pytest.raises(mpm.InvalidValue, match=words):
        kind(**(USUAL[kind] | given))


def test_a_mobile_collider_stays_where_a_wrong_pose_would_place_it() -> None:
    """A refused mobility changes nothing, the pose included."""
    place = at(0.075, 0.075, 0.15)
    solver = mpm.Solver(grid=GRID, bodies=[BODY], colliders=[mpm.Collider(BALL, mobile=True, pose=place)])
    for W, pose in ((np.eye(6), at(NAN, 0, 0)), (-np.eye(6), at(0.1, 0.1, 0.1))):
        with pytest.raises(mpm.InvalidValue, match="mobility of collider 0"):
            solver.set_collider_mobility(0, W, np.zeros(6), pose=pose)
        assert solver.collider_pose(0) is place


def test_a_solver_of_a_precision_starts_the_backend() -> None:
    """As one without; `mpm.init` is called for those who do not."""
    script = ("import mpm; elastic = mpm.Elastic(E=1e5, nu=0.2, density=1e3); mpm.Solver(precision='f64', "
              "grid=mpm.Grid((0, 0, 0), (0.1, 0.1, 0.1), 0.02), "
              "bodies=[mpm.Body(elastic, mpm.sample_box((0,) * 3, (0.02,) * 3, 0.01), volume=1e-6)])")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
