"""The robot's specification: arm, hand, and the tool fixed in the hand."""

import mujoco

from mpm import Pose
from robosim.scene.models import allow_empty_prefixes, load_spec

ARM_JOINTS = tuple(f"A{i}" for i in range(1, 8))


def build_robot_spec(tool: str | None) -> mujoco.MjSpec:
    """Assemble arm, hand and tool; the fingers close around the tool's handle.

    tool: a name of models/tools, or None for an empty hand.
    """
    arm = load_spec("robots", "iiwa14", "iiwa14.xml")
    hand = load_spec("grippers", "robotiq_3f", "robotiq_3f.xml")
    T_palm_grip = _find_site_pose(hand, "grip", "palm")
    with allow_empty_prefixes():
        arm.attach(hand, site=arm.site("flange"), prefix="")
        if tool is not None:
            part = load_spec("tools", tool, f"{tool}.xml")
            T_palm_tool = T_palm_grip @ _find_site_pose(part, f"{tool}_grip", tool).inverse()
            frame = arm.body("palm").add_frame(pos=T_palm_tool.position, quat=T_palm_tool.quaternion)
            frame.attach_body(part.body(tool), "", "")
    return arm


def _find_site_pose(spec: mujoco.MjSpec, site: str, body: str) -> Pose:
    """Find the pose of a site in a body's frame, in the compiled model's zero posture."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    T_ws = Pose.from_matrix(data.site(site).xpos, data.site(site).xmat.reshape(3, 3))
    return Pose(data.body(body).xpos.copy(), data.body(body).xquat.copy()).inverse() @ T_ws
