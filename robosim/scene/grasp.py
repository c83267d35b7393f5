"""How the hand holds a tool: fixed in the palm, or by the friction of its fingers."""

from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import mpm
from robosim.scene.frames import body_pose

HOLDER = "tool_holder"
"""Name of the equality constraint that holds a free tool while the fingers close."""
FINGERS = ("f1", "f2", "fm")
OPEN, CLOSED = 0.0, 0.9
"""Finger commands [rad]: closed presses the pads on a handle of 11 mm radius."""
SQUEEZE = 0.17
"""Largest command beyond the fingers' angle [rad]: 28 N a finger, 56 N the thumb, which opposes two. The thumb's limit
is 60 N; above it the thumb would give way on a tool thicker than a handle."""


def release_tool_joints(spec: mujoco.MjSpec, tool: str) -> None:
    """Give the tool in the hand six degrees of freedom, for a grasp by friction.

    The joints lie between palm and tool. As a free body of the world the tool would creep by 1 mm in a second while the
    arm moves: MuJoCo's contacts neglect the rate of their Jacobian, which is the hand's centripetal acceleration in
    such coordinates, and friction responds with a slip velocity in proportion to the contact's time constant. A stiff
    weld to the palm holds the tool until `Grasp.release`. Contact uses the elliptic cone with stiff friction: under the
    pyramidal cone a held tool creeps.
    """
    body = spec.body(tool)
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    for solid in (geom for geom in body.geoms if geom.contype):
        for part in ("palm_disc", "palm_box"):  # MuJoCo makes no contacts between a body and its parent otherwise
            spec.add_pair(geomname1=part, geomname2=solid.name)
    spec.add_equality(name=HOLDER, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="palm",
                      name2=tool, solref=[0.004, 1.0], solimp=[0.999, 0.9999, 0.001, 0.5, 2.0],
                      data=[0.0] * 10 + [1.0, 0.0])  # a zero quaternion: the relative pose of the compiled model
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0


class Grasp:
    """The tool in the hand and its slip; for a fixed tool the slip stays zero."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, tool: int) -> None:
        self._model, self._data, self._tool, self._palm = model, data, tool, model.body("palm").id
        self.is_by_friction = bool(model.body_jntnum[tool])
        """Whether the tool can slip."""
        self._fingers = [model.actuator(name).id for name in FINGERS]
        self._knuckles = model.jnt_qposadr[model.actuator_trnid[self._fingers, 0]]
        self._pose_at_release: mpm.Pose | None = None
        self.slip = 0.0
        """Largest displacement [m] of the handle in the fingers since the release."""
        self.slip_angle = 0.0
        """Largest rotation [rad] of the handle in the fingers since the release."""

    @property
    def is_released(self) -> bool:
        """Whether the fingers alone hold the tool."""
        return self._pose_at_release is not None

    def close(self, progress: float) -> None:
        """Command the fingers between open (0) and closed (1).

        The command is at most SQUEEZE beyond their present angle.
        """
        f1, f2, thumb = self._data.qpos[self._knuckles]
        angle = 0.5 * (0.5 * (f1 + f2) + thumb)
        self._data.ctrl[self._fingers] = min(OPEN + progress * (CLOSED - OPEN), angle + SQUEEZE)

    def release(self) -> None:
        """Switch the weld to the palm off: from now on the fingers alone hold the tool."""
        if self.is_by_friction and not self.is_released:
            self._data.eq_active[self._model.equality(HOLDER).id] = 0
            self._pose_at_release = self._grip_in_palm()

    def restart(self) -> None:
        """Measure slip from the present pose on, after the scene was set to another state."""
        self.slip = self.slip_angle = 0.0
        if self._pose_at_release is not None:
            self._pose_at_release = self._grip_in_palm()

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
        if self._pose_at_release is not None:
            now = self._grip_in_palm()
            self.slip = max(self.slip, float(np.linalg.norm(now.position - self._pose_at_release.position)))
            rotation = Rotation.from_matrix(now.matrix @ self._pose_at_release.matrix.T)
            self.slip_angle = max(self.slip_angle, float(rotation.magnitude()))

    def _grip_in_palm(self) -> mpm.Pose:
        """Pose of the handle's grip site, which the fingers hold, in the palm's frame."""
        T_pt = body_pose(self._data, self._palm).inverse() @ body_pose(self._data, self._tool)
        grip = self._model.site(f"{self._model.body(self._tool).name}_grip").pos
        return mpm.Pose(T_pt.position + T_pt.matrix @ grip, T_pt.quaternion)
