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


URDF = """<robot name="lab"><link name="base_link"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
</link>{links}<link name="tool0"/><joint name="to_tool" type="fixed"><parent link="l5"/><child link="tool0"/>
<origin xyz="0 0 0.1" rpy="0.3 0 0"/></joint></robot>"""
LINK = """<link name="l{k}"><inertial><origin xyz="0 0 0.1"/><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.01"
ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.04" length="0.15"/>
</geometry></collision></link><joint name="q{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
<origin xyz="0 0 0.2"/><axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" effort="10{k}" velocity="{k}.5"/></joint>"""


def write_urdf(path: Path, *changes: tuple[str, str]) -> Path:
    """Write a URDF of six links with inertia, limits and a fixed flange; changes: old text, new text."""
    axes = ("0 0 1", "0 1 0")
    text = URDF.format(links="".join(LINK.format(k=k, parent=f"l{k - 1}" if k else "base_link", axis=axes[k % 2])
                                     for k in range(6)))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path
