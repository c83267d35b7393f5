"""Arms that tests write."""

from pathlib import Path


def write_arm(path: Path, joints: int, *, limited: bool = True, actuator: str = "position", slide: int | None = None,
              named: bool = True) -> Path:
    """Write a chain of links with alternating axes, whose last link has a finger beside the flange."""
    bodies, ends = "", ""
    for k in range(joints):
        axis = "0 0 1" if k % 2 == 0 else "0 1 0"
        kind = ' type="slide" range="-0.2 0.3"' if k == slide else ' range="-100 120"' if limited else ""
        name = f' name="j{k}"' if named else ""
        bodies += f'<body name="l{k}" pos="0 0 0.2"><joint{name} axis="{axis}"{kind}/>' \
                  f'<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.03"/>'
        ends += "</body>"
    finger = '<body name="finger"><joint name="f" axis="1 0 0" range="0 10"/><geom size="0.01"/></body>'
    actuators = "".join(f'<{actuator} joint="j{k}" forcerange="{-20 - k} {20 + k}" gear="2"/>' for k in range(joints)) \
        if named else ""
    path.write_text(f'<mujoco><worldbody><body name="stand">{bodies}<site name="tip" pos="0 0 0.25"/>{finger}{ends}'
                    f'</body></worldbody><actuator>{actuators}<motor name="f" joint="f"/></actuator>'
                    f'<keyframe><key qpos="{"0 " * (joints + 1)}"/></keyframe></mujoco>')
    return path
