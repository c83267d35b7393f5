"""Cases of colliders, of MuJoCo scenes coupled to grains, and of differentiable rollouts."""

from typing import Any

import gymnasium
import mujoco
import numpy as np
import trimesh
from fields import CELL, LAWS, POINT, SAND, at, block, box
from groups import BOTH, case_of
from internals import goal_loss, keep_gradients, keep_solver, solver_of
from keep import Keep

import mpm
import robosim

BOXES = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="light" pos="0.03 0.04 0.056" quat="0.99 0.05 0.1 0"><freejoint/>
      <geom type="box" size="0.012 0.012 0.012" density="800" friction="0.4"/></body>
    <body name="arm" pos="0.09 0.04 0.11">
      <joint name="swing" type="hinge" axis="0 1 0" frictionloss="0.001" damping="0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.04" size="0.004" mass="0.02" contype="0" conaffinity="0"/>
      <body name="bob" pos="0 0 -0.055"><joint name="turn" type="hinge" axis="0 0 1" damping="1e-5"/>
        <geom type="ellipsoid" size="0.012 0.016 0.014" mass="0.05" friction="0.3"/></body></body>
    <body name="cart" mocap="true" pos="0.01 0.04 0.05">
      <body name="blade"><geom type="box" size="0.003 0.02 0.015" friction="0.4"/></body></body>
  </worldbody>
</mujoco>
"""


def bowl(radius: float = 0.03) -> mpm.Shell:
    """The lower half of a hollow ball."""
    ball = trimesh.creation.icosphere(3, radius)
    return mpm.Shell.from_mesh(trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0]), 1.5e-3)


def can() -> mpm.Shell:
    """A square can of 36 mm, its floor at z = 0, open on top."""
    whole = trimesh.creation.box((0.036, 0.036, 0.06))
    whole = trimesh.Trimesh(whole.vertices, whole.faces[whole.triangles_center[:, 2] < 0.029])
    whole.apply_translation((0, 0, 0.03))
    return mpm.Shell.from_mesh(whole, 1.5e-3)


def shape_of(name: str) -> Any:
    wedge = trimesh.creation.box((0.03, 0.04, 0.02))
    wedge.vertices[wedge.vertices[:, 2] > 0] *= [0.4, 1.0, 1.0]
    return {"sphere": lambda: mpm.Sdf.sphere(0.018), "box": lambda: mpm.Sdf.box((0.015, 0.02, 0.01)),
            "mesh": lambda: mpm.Sdf.from_mesh(wedge, spacing=2.5e-3), "bowl": bowl}[name]()


def meet(keep: Keep, shape: str, law: Any = SAND, moves: bool = True, **options: Any) -> None:
    """A block falls onto a collider, which stands or turns and moves through it."""
    middle, static = np.array([0.043, 0.047, 0.021]), options.pop("static", False)
    collider = mpm.Collider(shape_of(shape), friction=0.3, pose=at(*middle), static=static)
    body = block(law, (0.02, 0.02, 0.05), (0.07, 0.07, 0.08))
    with box(body, colliders=[collider], **options) as solver:
        pose = collider.pose
        for k in range(20):
            half = 0.03 * (k + 1)
            end = mpm.Pose(middle + [0.0008 * (k + 1), 0.0, 0.0005 * (k + 1)],
                           np.array([np.cos(half), 0.0, np.sin(half), 0.0]))
            if moves:
                solver.set_collider_motion(0, pose, end)
                pose = end
            solver.advance(4e-3)
            keep("impulse", solver.collider_impulse(0))
            keep("ledger", solver.ledger)
        keep("clearance", solver.clearance(0))
        keep_solver(keep, solver)


def leak(keep: Keep, **options: Any) -> None:
    """A can with two small holes is shaken and tilted; what jams is opened again."""
    grains = mpm.sample_box((-0.018, -0.018, 0.0), (0.018, 0.018, 0.03), CELL / 2, np.random.default_rng(0))
    grains = grains[(np.abs(grains[:, :2]) < 0.015).all(1) & (grains[:, 2] > 0.003)]
    start = np.array([0.05, 0.045, 0.045])
    holes = mpm.Orifice(np.array([[-0.008, 0.0, 0.0], [0.008, 0.002, 0.0]]), np.array([0.0, 0.0, -1.0]), diameter=8e-3,
                        grain_diameter=1.4e-3, blocked_ratio=2.0)
    shell = mpm.Collider(can(), friction=0.3, pose=at(*start), orifices=[holes])
    with box(mpm.Body(SAND, start + grains, volume=POINT), colliders=[shell], upper=(0.1, 0.09, 0.12),
             **options) as solver:
        for k in range(60):
            ends = [start + [0.0, 0.0, 1e-3 * np.sin(0.4 * step)] for step in (k, k + 1)]
            solver.set_collider_motion(0, *(at(*end) for end in ends))
            solver.advance(4e-3)
            keep("passed", solver.passed_mass(0))
        keep_solver(keep, solver)


def float_free(keep: Keep, shape: str, **options: Any) -> None:
    """A block falls onto a collider that contact moves, without MuJoCo."""
    start = np.array([0.05, 0.045, 0.045])
    collider = mpm.Collider(shape_of(shape), friction=0.3, pose=at(*start), mobile=True)
    low = mpm.sample_box((0.0, 0.0, 0.0), (0.1, 0.09, 0.02), CELL / 2)
    bodies = [mpm.Body(SAND, low, volume=POINT), block(SAND, (0.03, 0.03, 0.07), (0.07, 0.06, 0.09))]
    with box(*bodies, colliders=[collider], **options) as solver:
        twist = np.array([0.1, 0.0, -0.4, 0.0, 0.0, 2.0])
        for _ in range(25):
            solver.set_collider_mobility(0, np.diag([8.0] * 3 + [3e4] * 3), twist + [0, 0, -9.81 * 4e-3, 0, 0, 0],
                                         twist=twist)
            solver.advance(4e-3)
            twist = np.concatenate(solver.collider_twist(0))
            keep("twist", twist)
            keep("residual", solver.contact_residual)
        keep_solver(keep, solver)


def couple(keep: Keep, steps: int = 60, **choices: Any) -> None:
    """A free box, a pendulum and a blade on a mocap body in sand; choices: of the plugin, and "contact", "sleep"."""
    model = mujoco.MjModel.from_xml_string(BOXES)
    data = mujoco.MjData(model)
    data.qpos[7] = 0.7
    own = {name: choices.pop(name) for name in ("contact", "sleep", "transfer_interval") if name in choices}
    positions = mpm.sample_box((0.0, 0.0, 0.0), (0.12, 0.08, 0.04), CELL / 2, np.random.default_rng(0))
    body = mpm.Body(SAND, positions, volume=POINT)
    with box(body, upper=(0.12, 0.08, 0.12), **own) as solver:
        plugin = robosim.GranularPlugin(model, data, solver, bodies={"light": None, "bob": None, "blade": None},
                                        **choices)
        for _ in range(steps):
            data.mocap_pos[0, 0] += 2e-4
            plugin.step()
            keep("qpos", data.qpos)
            keep("wrench", [np.concatenate(plugin.wrench(name)) for name in ("light", "bob", "blade")])
            keep("ledger", plugin.ledger.residual)
            keep("repeats", plugin.repeats)
        keep("qvel", data.qvel)
        keep("prediction error", plugin.prediction_error)
        keep_solver(keep, solver)


def roll(keep: Keep, shape: str, *laws: Any, **options: Any) -> None:
    """A tool passes through blocks on the floor; the loss is their distance from a place."""
    bodies = [block(law, (0.03, 0.02 + 0.03 * k, 0.0), (0.06, 0.05 + 0.03 * k, 0.03), (0.0, 0.0, 0.0))
              for k, law in enumerate(laws)]
    tool = mpm.Collider(shape_of(shape), friction=0.3, pose=at(0.0251, 0.0403, 0.0357))
    post = mpm.Collider(mpm.Sdf.sphere(0.012), friction=0.2, static=True, pose=at(0.08, 0.04, 0.0))
    rest = {name: options.pop(name) for name in ("contact", "transfer_interval") if name in options}
    with box(*bodies, colliders=[tool, post], **rest) as solver:
        solver.advance(0.01)
        path = mpm.Rollout(solver, 12, step_dt=5 * solver.dt, **options)
        linear, angular = np.tile([0.25, 0.02, -0.02], (12, 1)), np.tile([0.3, 0.8, 0.5], (12, 1))
        loss = goal_loss((0.09, 0.05, 0.02))
        value, gradient = path.value_and_grad(linear, angular, loss)
        keep("value", value)
        keep("gradient", gradient)
        keep_gradients(keep, path)
        keep_solver(keep, solver)
        path.restart()
        keep("value", path.value(linear, angular, loss))
        path.close()


def learn(keep: Keep, task: str, steps: int = 10) -> None:
    """The gradient of a task's objective over the first steps of an episode, with the tool at rest and moving."""
    env = gymnasium.make(f"robosim/{task}-v0")
    env.reset(seed=0)
    path, loss = env.unwrapped.rollout(steps, materials=True), env.unwrapped.objective()
    for speed in (0.0, 0.05):
        value, gradient = path.value_and_grad(np.full((steps, 3), speed), np.full((steps, 3), 10 * speed), loss)
        keep("value", value)
        keep("gradient", gradient)
        keep_gradients(keep, path)
    keep_solver(keep, solver_of(env))
    path.close()
    env.close()


CASES = [
    case_of("collider/sphere", meet, "sphere", usual="f32", more="f64"),
    case_of("collider/static box", meet, "box", static=True, moves=False, usual="f64", more="f32"),
    case_of("collider/mesh", meet, "mesh", usual="f64", more="f32 ieee threads"),
    case_of("collider/touching", meet, "mesh", contact="touching", usual="f64", more="f32"),
    case_of("collider/static mesh", meet, "mesh", static=True, moves=False, more=BOTH),
    case_of("collider/fluid", meet, "mesh", LAWS["fluid"], more=BOTH),
    case_of("shell/moving", meet, "bowl", usual="f32", more="f64 ieee threads"),
    case_of("shell/fluid", meet, "bowl", LAWS["fluid by cells"], more=BOTH),
    case_of("shell/elastic", meet, "bowl", LAWS["hencky"], transfer_interval=0.0, more=BOTH),
    case_of("holes", leak, usual="f32", more="f64 ieee"),
    case_of("mobile/bowl", float_free, "bowl", transfer_interval="strides", usual="f64", more="f32"),
    case_of("mobile/bowl", float_free, "bowl", usual="threads"),
    case_of("mobile/sphere", float_free, "sphere", more=BOTH),
    case_of("plugin/mobility", couple, usual=BOTH, more="ieee threads"),
    case_of("plugin/lagged", couple, coupling="lagged", usual="f64", more="f32"),
    case_of("plugin/one way", couple, coupling="one_way", usual="f64", more="f32"),
    case_of("plugin/touching", couple, contact="touching", usual="f32", more="f64"),
    case_of("plugin/lagged touching", couple, coupling="lagged", contact="touching", more="f64"),
    case_of("plugin/one way touching", couple, coupling="one_way", contact="touching", more="f64"),
    case_of("plugin/strict", couple, tolerance=1e-4, sleep=True, more=BOTH),
    case_of("plugin/strides", couple, transfer_interval="strides", more=BOTH),
    case_of("rollout/sand", roll, "mesh", SAND, materials=True, usual="f64", more="ieee"),
    case_of("rollout/sand and fluid", roll, "mesh", SAND, LAWS["fluid"], materials=True, more="f64"),
    case_of("rollout/bowl", roll, "bowl", SAND, more="f64"),
    case_of("rollout/clay", roll, "mesh", LAWS["clay"], contact="touching", more=BOTH),
    case_of("rollout/hencky", roll, "mesh", LAWS["hencky"], limit=1e3, window=4, more=BOTH),
    case_of("rollout/corotated", roll, "mesh", LAWS["corotated"], svd=False, more="f64"),
    case_of("rollout/mu(I)", roll, "mesh", LAWS["mu(I)"], soft=0.1, materials=True, more="f64"),
    case_of("rollout/svd", roll, "mesh", SAND, svd=True, budget=2_000_000, more="f64"),
    case_of("rollout/fluid by cells", roll, "mesh", LAWS["fluid by cells"], more="f64"),
    *(case_of(f"rollout/{task}", learn, task, more="f32") for task in ("SpoonPour", "SpoonScoop")),
]
