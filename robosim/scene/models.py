"""MJCF models of models/: loading and compiling their specifications, and the robot with its tool and sensors."""

import contextlib
import warnings
from collections.abc import Iterator

import mujoco
import numpy as np

from mpm import Pose
from robosim.config.resources import folder
from robosim.errors import ConfigError

ARM_JOINTS = tuple(f"A{i}" for i in range(1, 8))


def load_spec(*parts: str) -> mujoco.MjSpec:
    """Load the specification of a file below models/, given by the parts of its path.

    Raises ConfigError where there is no such file.
    """
    path = folder("models").joinpath(*parts)
    if not path.is_file():
        raise ConfigError(f"model file {path} is missing; the installation is incomplete")
    return mujoco.MjSpec.from_file(str(path))


def read_inner_size(container: str) -> np.ndarray:
    """Read the inner size (3,) [m] of a container of models/containers.

    A box-shaped site in its file marks it.
    """
    return 2.0 * np.array(load_spec("containers", f"{container}.xml").site(f"{container}_inside").size)


@contextlib.contextmanager
def allow_empty_prefixes() -> Iterator[None]:
    """Suppress MuJoCo's warning about attaching with an empty prefix.

    All names in models/ are unique, and sensors and joints are looked up by these names.
    """
    mujoco.set_mju_user_warning(lambda text: None)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*prefix.*")
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(None)


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification without MuJoCo's warning about empty prefixes."""
    with allow_empty_prefixes():
        return spec.compile()


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


def add_wrist_sensor(spec: mujoco.MjSpec) -> None:
    """Add force and torque sensors between flange and hand.

    They measure in the axes of the site `wrist_sensor`.
    """
    spec.body("palm").add_site(name="wrist_sensor", group=4)
    kinds = {"wrist_force": mujoco.mjtSensor.mjSENS_FORCE, "wrist_torque": mujoco.mjtSensor.mjSENS_TORQUE}
    for name, kind in kinds.items():
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrist_sensor")


def add_torque_sensors(spec: mujoco.MjSpec) -> None:
    """Add a torque sensor to each arm joint.

    It is on the link's side of motor, rotor and bearing friction.
    """
    for name in ARM_JOINTS:
        body = spec.joint(name).parent
        body.add_site(name=f"{name}_torque_site", pos=spec.joint(name).pos, group=4)
        spec.add_sensor(name=f"{name}_torque", type=mujoco.mjtSensor.mjSENS_TORQUE, objtype=mujoco.mjtObj.mjOBJ_SITE,
                        objname=f"{name}_torque_site")
