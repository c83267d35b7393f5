"""How the hand holds a tool: fixed in it, or by the friction of its fingers alone."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import mpm
from robosim.scene.frames import body_pose

HOLDER = "tool_holder"
"""Name of the equality that holds a loose tool while the fingers close."""
FINGERS = ("f1", "f2", "fm")
OPEN, CLOSED = 0.0, 0.9
"""Finger commands [rad]: closed presses the pads on a handle of 11 mm radius."""
SQUEEZE = 0.17
"""Command beyond the fingers' angle [rad] when they have closed: 28 N a finger, 56 N the thumb, which opposes two. Past
its 60 N it would give way, and what is thicker than a handle would move until the two press less."""


def make_loose(spec: mujoco.MjSpec, tool: str) -> None:
    """Let a tool move in the hand that it is fixed in, for fingers to hold.

    Six joints between palm and tool say where it is. As a free body of the world it would creep while the arm moves,
    1 mm in a second: MuJoCo's contacts leave out how their Jacobian turns, which is the hand's centripetal acceleration
    in such coordinates, and friction answers it by a speed of slip in proportion to the contact's time constant. A
    stiff stand holds the tool (an equality with the palm) until `Grasp.release`. Contact takes MuJoCo's elliptic cone
    with stiff friction: with the pyramid a held tool creeps.
    """
    body = spec.body(tool)
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    for solid in (geom for geom in body.geoms if geom.contype):
        for part in ("palm_disc", "palm_box"):  # a body and what moves in it touch by declaration alone
            spec.add_pair(geomname1=part, geomname2=solid.name)
    spec.add_equality(name=HOLDER, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="palm",
                      name2=tool, solref=[0.004, 1.0], solimp=[0.999, 0.9999, 0.001, 0.5, 2.0],
                      data=[0.0] * 10 + [1.0, 0.0])  # places as they are now
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0


class Grasp:
    """A tool in the hand; for one that is fixed everything stays zero."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, tool: int) -> None:
        self._model, self._data, self._tool, self._palm = model, data, tool, model.body("palm").id
        self.by_friction = bool(model.body_jntnum[tool])
        self._fingers = [model.actuator(name).id for name in FINGERS]
        self._knuckles = model.jnt_qposadr[model.actuator_trnid[self._fingers, 0]]
        self._released: mpm.Pose | None = None
        self.slip, self.slip_angle = 0.0, 0.0
        """Largest way [m] and angle [rad] of the handle in the fingers since the release."""

    @property
    def holding(self) -> bool:
        """Whether the fingers alone hold the tool."""
        return self._released is not None

    def close(self, progress: float) -> None:
        """Command the fingers, from open (0) to closed (1), not further than SQUEEZE beyond where they are."""
        f1, f2, thumb = self._data.qpos[self._knuckles]
        there = 0.5 * (0.5 * (f1 + f2) + thumb)
        self._data.ctrl[self._fingers] = min(OPEN + progress * (CLOSED - OPEN), there + SQUEEZE)

    def release(self) -> None:
        """Take the stand away: the fingers hold the tool from now on."""
        if self.by_friction and not self.holding:
            self._data.eq_active[self._model.equality(HOLDER).id] = 0
            self._released = self._in_palm()

    def restart(self) -> None:
        """Measure slip from here on, after the user put the scene into another state."""
        self.slip = self.slip_angle = 0.0
        if self._released is not None:
            self._released = self._in_palm()

    def watch(self) -> None:
        """Measure how far the tool has slipped."""
        if self._released is not None:
            now = self._in_palm()
            self.slip = max(self.slip, float(np.linalg.norm(now.position - self._released.position)))
            turn = Rotation.from_matrix(now.matrix @ self._released.matrix.T)
            self.slip_angle = max(self.slip_angle, float(turn.magnitude()))

    def _in_palm(self) -> mpm.Pose:
        """Pose of the handle's grip, which the fingers hold, in the palm."""
        T_pt = body_pose(self._data, self._palm).inverse() @ body_pose(self._data, self._tool)
        grip = self._model.site(f"{self._model.body(self._tool).name}_grip").pos
        return mpm.Pose(T_pt.position + T_pt.matrix @ grip, T_pt.quaternion)
