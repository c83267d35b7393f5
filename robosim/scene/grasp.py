"""How the hand holds a tool: fixed in the palm, or by the friction of its fingers."""

from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import mpm
from robosim.base.errors import ConfigError
from robosim.robot.assembly import HAND_PREFIX, Assembly
from robosim.robot.mjspec import BARE, body_ids_below, body_pose
from robosim.scene.compiled import Scene

CLOSING_SHARE = 0.6
"""Share of the grasp time in which the fingers close; in the rest they settle on the handle."""
HOLDER = "tool_holder"
"""Name of the equality constraint that holds a free tool while the fingers close."""


def release_tool_joints(spec: mujoco.MjSpec, assembly: Assembly, stand: mpm.Pose | None = None) -> None:
    """Give the tool in the hand six degrees of freedom, for a grasp by friction.

    The joints lie between palm and tool. As a free body of the world the tool would creep by 1 mm in a second while the
    arm moves, as MuJoCo's contacts neglect the rate of their Jacobian, the hand's centripetal acceleration. A stiff
    weld holds the tool until `Grasp.release`: to the palm, or where it stands in the world. Contact uses the elliptic
    cone: under the pyramidal one a held tool creeps. Its friction is 100 times as stiff as the pads, as a load makes
    soft friction creep: at 20 times by 8 um/s at the lip of a filled spoon. Raises ConfigError for a tool that is
    bolted to the flange."""
    if assembly.hand is None or assembly.tool is None:
        raise ConfigError("grasp: friction with gripper: none; accepted: grasp: weld, or a gripper")
    body = spec.body(assembly.tool.name)
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    palm = [geom for geom in spec.body(assembly.wrist).geoms if geom.contype or geom.conaffinity]
    for number, part in enumerate(palm):
        part.name = part.name or f"{assembly.wrist}_{number}"
    for solid in (geom for geom in body.geoms if geom.contype & 1):
        for part in palm:  # MuJoCo makes no contacts between a body and its parent otherwise
            spec.add_pair(BARE.default, geomname1=part.name, geomname2=solid.name)
    place = np.zeros(7) if stand is None else np.concatenate(stand)  # zero: the relative pose of the compiled model
    spec.add_equality(BARE.default, name=HOLDER, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY,
                      name1=assembly.wrist if stand is None else "world", name2=assembly.tool.name,
                      solref=[0.004, 1.0], solimp=[0.999, 0.9999, 0.001, 0.5, 2.0],
                      data=[0.0, 0.0, 0.0, *place, 1.0, 0.0])
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0


def put_tool(scene: Scene, data: mujoco.MjData, pose: mpm.Pose) -> None:
    """Put a tool that the hand does not hold yet to a world pose; data: with the arm in its posture."""
    mujoco.mj_kinematics(scene.model, data)
    model = scene.model
    held = mpm.Pose(model.body_pos[scene.tool], model.body_quat[scene.tool])
    relative = (body_pose(data, scene.wrist) @ held).inverse() @ pose
    first = model.jnt_qposadr[model.body_jntadr[scene.tool]]
    data.qpos[first : first + 7] = np.concatenate(relative)


class Grasp:
    """The tool in the hand and its slip; for a fixed tool the slip stays zero.
    tip: point (3,) [m] of the tool's frame whose slip counts as the grip's does; None: the grip's alone."""

    def __init__(self, scene: Scene, data: mujoco.MjData, tip: np.ndarray | None = None) -> None:
        self._model, self._data, self._tool, self._palm = scene.model, data, scene.tool, scene.wrist
        self.is_by_friction = bool(scene.model.body_jntnum[scene.tool])
        """Whether the tool can slip."""
        hand, tool = scene.assembly.hand, scene.assembly.tool
        commands = {} if hand is None else hand.open
        self._fingers = [scene.model.actuator(HAND_PREFIX + name).id for name in commands]
        self._open = np.array([commands[name] for name in commands])
        self._way = np.array([hand.closed[name] - commands[name] for name in commands] if hand else [])
        self._squeeze = np.inf if hand is None or hand.squeeze is None else hand.squeeze
        grip = np.zeros(3) if tool is None else scene.model.site(tool.grip).pos
        self._points = np.stack([grip, grip if tip is None else tip])
        self._holding = np.setdiff1d(body_ids_below(scene.model, scene.wrist), body_ids_below(scene.model, scene.tool))
        self._data.ctrl[self._fingers] = self._open
        self._pose_at_release: mpm.Pose | None = None
        self.slip = 0.0
        """Largest displacement [m] of the grip, or of the tip, in the hand since the release."""
        self.slip_angle = 0.0
        """Largest rotation [rad] of the tool in the hand since the release."""

    @property
    def is_released(self) -> bool:
        """Whether the fingers alone hold the tool."""
        return self._pose_at_release is not None

    def close(self, progress: float) -> None:
        """Command the fingers between open (0) and closed (1), at most the hand's squeeze beyond their present place.
        That is the middle between the finger that has closed most and the one that has closed least."""
        if not self._fingers:
            return
        if np.isfinite(self._squeeze):
            moved = self._way != 0.0
            places = ((self._data.actuator_length[self._fingers] - self._open)[moved] / self._way[moved])
            progress = min(progress, 0.5 * float(places.min() + places.max()) + self._squeeze)
        self._data.ctrl[self._fingers] = self._open + progress * self._way

    def release(self) -> None:
        """Switch the weld to the palm off: from now on the fingers alone hold the tool.
        Raises ConfigError where fewer than two parts of the hand touch it: it would drop."""
        if self.is_by_friction and not self.is_released:
            touching = self._model.geom_bodyid[self._data.contact.geom]
            touching = touching[(touching == self._tool).any(1)]
            if len(np.intersect1d(touching, self._holding)) < 2:
                tool = self._model.body(self._tool).name
                raise ConfigError(f"grasp: friction: the hand has not closed on {tool} when it should carry it; "
                                  f"accepted: a longer grasp_time, or a handle within its reach")
            self._data.eq_active[self._model.equality(HOLDER).id] = 0
            self._pose_at_release = self._pose_in_palm()

    def open(self, progress: float) -> None:
        """Command the fingers from closed (0) to open (1), and measure no slip from now on."""
        self._pose_at_release = None
        if self._fingers:
            self._data.ctrl[self._fingers] = self._open + (1.0 - progress) * self._way

    def restart(self) -> None:
        """Measure slip from the present pose on, after the scene was set to another state."""
        self.slip = self.slip_angle = 0.0
        if self._pose_at_release is not None:
            self._pose_at_release = self._pose_in_palm()

    def state(self) -> dict[str, Any]:
        """Return the pose at the release, None before it, and the slip since."""
        pose = self._pose_at_release
        return {"pose_at_release": None if pose is None else np.concatenate(pose), "slip": self.slip,
                "slip_angle": self.slip_angle}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        pose = state["pose_at_release"]
        self._pose_at_release = None if pose is None else mpm.Pose(*np.split(np.array(pose, float), [3]))
        self.slip, self.slip_angle = state["slip"], state["slip_angle"]

    def measure_slip(self) -> None:
        """Update `slip` and `slip_angle` with the present pose."""
        if (before := self._pose_at_release) is not None:
            now = self._pose_in_palm()
            moved = now.apply(self._points) - before.apply(self._points)
            self.slip = max(self.slip, float(np.linalg.norm(moved, axis=1).max()))
            rotation = Rotation.from_matrix(now.matrix @ before.matrix.T)
            self.slip_angle = max(self.slip_angle, float(rotation.magnitude()))

    def _pose_in_palm(self) -> mpm.Pose:
        """Pose of the tool in the palm's frame."""
        return body_pose(self._data, self._palm).inverse() @ body_pose(self._data, self._tool)
