"""How the hand holds a tool: fixed in it, or by the friction of its fingers alone."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import mpm
from robosim.frames import body_pose

HOLDER = "tool_holder"
"""Name of the equality that holds a loose tool while the fingers close."""


def make_loose(spec: mujoco.MjSpec, held: mujoco.MjModel, tool: str, part: mujoco.MjSpec) -> None:
    """Add a tool as a free body at the place that it has in the hand in the scene `held`, for fingers to hold.

    A stand holds it (an equality with the palm) until `Grasp.release`. Contact takes MuJoCo's elliptic cone with stiff
    friction: with the pyramid a held tool creeps.
    """
    data = mujoco.MjData(held)
    mujoco.mj_kinematics(held, data)
    pose = body_pose(data, held.body(tool).id)
    spec.worldbody.add_frame(pos=pose.position, quat=pose.quaternion).attach_body(part.body(tool), "", "")
    spec.body(tool).add_freejoint()
    spec.add_equality(name=HOLDER, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="palm",
                      name2=tool, solref=[0.004, 1.0], data=[0.0] * 10 + [1.0, 0.0])  # places as they are now
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0


class Grasp:
    """A tool in the hand; for one that is fixed everything stays zero."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, tool: int) -> None:
        self._model, self._data, self._tool, self._palm = model, data, tool, model.body("palm").id
        self.by_friction = bool(model.body_jntnum[tool])
        self._released: mpm.Pose | None = None
        self.slip, self.slip_angle = 0.0, 0.0
        """Largest way [m] and angle [rad] of the handle in the fingers since the release."""
        if self.by_friction:
            initial = mujoco.MjData(model)
            mujoco.mj_kinematics(model, initial)
            mujoco.mj_kinematics(model, data)
            held = body_pose(initial, self._palm).inverse() @ body_pose(initial, tool)
            pose = body_pose(data, self._palm) @ held
            start = model.jnt_qposadr[model.body_jntadr[tool]]
            data.qpos[start : start + 7] = np.concatenate(pose)
            mujoco.mj_forward(model, data)

    @property
    def holding(self) -> bool:
        """Whether the fingers alone hold the tool."""
        return self._released is not None

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
