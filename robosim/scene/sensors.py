"""Sensors of the robot: force and torque at the wrist, torque in each arm joint."""

import mujoco

from robosim.scene.robot_spec import ARM_JOINTS


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
