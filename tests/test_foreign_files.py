"""Damaged files of other programs, and recordings: each is read or refused in one line, within 2 GB and 10 s."""

import contextlib
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
import zstandard
from extreme_values import OWN, changed_elements, changed_texts, damaged, fuzz, handle
from hypothesis import strategies as st
from own_arm import write_description
from PIL import Image
from written_arms import write_arm

from robosim.commands.new import draft_arm
from robosim.config.arm import ArmConfig, GripperConfig
from robosim.config.table import validate
from robosim.conversion.gltf import write_frame
from robosim.conversion.joint_log_files import read_joint_log
from robosim.recordings.appearance import build_appearance
from robosim.recordings.reader import Recording
from robosim.recordings.scene_recorder import SceneRecorder
from robosim.recordings.writer import BLOCK, MAGIC
from robosim.robot.hand import load_hand_model
from robosim.robot.mjspec import compile_spec
from robosim.robot.robot import load_robot_model
from robosim.shapes.mesh_files import read_parts, read_surface
from robosim.studies.calibration.data import make_rings, read_heap
from robosim.studies.calibration.measurements import HeapExperiment

BOWL, SHEET = ([[0, -30], [20, -20], [30, 0], [28, 0], [18, -19], [0, -28]], [[0, -30], [20, -20], [30, 0]])
"""Profiles [mm] of a bowl and of its middle."""
ASSETS = """<mujoco><asset><mesh name="part" file="mesh.stl" scale="0.001 0.001 0.001"/><material name="grey"/></asset>
<tendon><fixed name="pull"><joint joint="f" coef="1"/></fixed></tendon><sensor><jointpos joint="j0"/></sensor>"""
HEAP = HeapExperiment(kind="heap", data="heap", unit="mm", scale=0.002, height_per_level=1.0, noise=0.002, radius=0.02,
                      height=0.02)


def write_file(folder: Path, name: str) -> Path:
    """Write a file that can be read, and the files it refers to."""
    path, heights = folder / name, np.maximum(0.0, 16 - 0.9 * np.hypot(*np.mgrid[-20:21, -20:21]))
    trimesh.creation.revolve(BOWL, sections=12).export(folder / "mesh.stl")
    arm = write_arm(folder / "arm.xml", 6)
    for old, new in (("<mujoco>", ASSETS), ('"tip"', '"tool0"'), ("<geom", '<geom type="mesh" mesh="part"/><geom')):
        arm.write_text(arm.read_text().replace(old, new, 1))
    if name == "arm.urdf":
        return write_description(folder)
    if name == "recording.rec":
        model = mujoco.MjModel.from_xml_path(str(arm))
        data = mujoco.MjData(model)
        recorder = SceneRecorder(path, model, data, None, kind="rehearsal", title="arm", tool="finger")
        for k in range(3):
            data.time = k / 20
            recorder.add(data)
        recorder.close()
    elif path.suffix in (".obj", ".ply", ".glb"):
        trimesh.creation.revolve(SHEET if name == "sheet.obj" else BOWL, sections=12).export(path)
    elif name == "heap.npy":
        np.save(path, heights)
    elif name == "heap.png":
        Image.fromarray(heights.astype(np.uint8)).save(path)
    elif path.suffix == ".csv":
        rows = "".join(f"{r / 9},{r},{r},{max(0.0, 16 - 0.45 * r)}\n" for r in range(45))
        path.write_text(f"time_s,q_a_rad,r,z\n{rows}")
    return path


def read_arm(path: Path) -> None:
    """Read a model as `robosim new` does, as an arm, and as a hand."""
    draft_arm(path)
    limits: Any = {"velocity": 6 * [3.0], "torque": 6 * [50.0]}
    table = {"model": str(path), "flange": "tool0", "limits": limits}
    compile_spec(load_robot_model(validate(table, path, ArmConfig), path.parent).spec)
    table = {"model": str(path), "grip": "tool0", "open": {"f": 0.04}, "closed": {"f": 0.0}}
    with contextlib.suppress(*OWN):  # not every arm has such a joint
        compile_spec(load_hand_model(validate(table, path, GripperConfig), path.parent).spec)


def read_mesh(path: Path) -> None:
    """Read a mesh of a model, and of a tool, closed or as a sheet."""
    if path.suffix in (".stl", ".obj"):
        model = path.with_name("model.xml")
        model.write_text(path.with_name("arm.xml").read_text().replace("mesh.stl", path.name))
        with contextlib.suppress(*OWN):
            read_arm(model)
    with contextlib.suppress(*OWN):
        read_parts(path, 1.0, 1e-3)
    read_surface(path, 1e-3)


def read_recording(path: Path) -> None:
    with Recording(path) as recording:
        recording.values()
        for k in range(len(recording)):
            recording.grains(k)
        compile_spec(build_appearance(recording.appearance, recording.header.bodies, path))
        write_frame(recording, 0.05, path.with_suffix(".glb"))


def read_map(path: Path) -> None:
    heap = HEAP.model_copy(update={"data": str(path)})
    make_rings("heap", heap, read_heap("heap", heap))


@st.composite
def changed_blocks(draw: Callable, content: bytes) -> bytes:
    """Draw a recording in which a block holds something else; its checksum fits."""
    blocks, place = [], len(MAGIC)
    while place < len(content):
        kind, size = BLOCK.unpack_from(content, place)
        place += BLOCK.size + size
        blocks.append((kind, content[place - size : place]))
    k = draw(st.integers(0, len(blocks) - 1))
    held = zstandard.ZstdDecompressor().decompress(blocks[k][1])
    changed = zstandard.ZstdCompressor().compress(draw(st.one_of(damaged(held), changed_texts(held))))
    blocks[k] = draw(st.sampled_from([blocks[k][0], blocks[k][0], blocks[0][0], blocks[-1][0]])), changed
    return MAGIC + b"".join(BLOCK.pack(kind, len(block)) + block for kind, block in blocks)


KINDS: dict[str, tuple[Callable[[Path], object], Callable[..., st.SearchStrategy[bytes]]]] = {
    **dict.fromkeys(["arm.xml", "arm.urdf"], (read_arm, changed_elements)),
    **dict.fromkeys(["mesh.stl", "mesh.ply"], (read_mesh, damaged)),
    **dict.fromkeys(["mesh.obj", "mesh.glb", "sheet.obj"], (read_mesh, changed_texts)),
    "recording.rec": (read_recording, changed_blocks), "heap.csv": (read_map, changed_texts),
    **dict.fromkeys(["heap.npy", "heap.png"], (read_map, damaged)),
    "log.csv": (lambda path: read_joint_log(path, ["a"]), changed_texts),
}
"""Name of a file -> its reader, and what draws changes besides those of bytes, numbers and names."""


HUGE = {
    "copies": '<worldbody><replicate count="100000000"><geom size="0.01"/></replicate></worldbody>',
    "copies of copies": "<worldbody>" + 3 * '<replicate count="1000">' + 3 * "</replicate>" + "</worldbody>",
    "included copies": '<include file="more.xml"/>', "a part of itself": '<asset><model file="arm.xml"/></asset>',
    "attached copies": '<asset><model file="more.xml"/></asset>',
    "copies of a part": '<asset><model file="few.xml"/></asset><worldbody><replicate count="2000"><attach/></replicate>'
                        '</worldbody>',
    "a flex": '<worldbody><flexcomp name="f" type="grid" dim="3" count="300 300 300" spacing="1 1 1"/></worldbody>',
    "a cable": '<worldbody><composite type="cable" count="10000000 1 1" size="1"/></worldbody>',
    "heights": '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
    "pixels": '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>',
    "vertices": '<asset><mesh name="p" builtin="plate" params="20000 20000"/></asset>',
    "keys": '<size nkey="100000000"/>', "a pipe": '<asset><mesh name="p" file="pipe.stl"/></asset>',
    "a pipe in a folder": '<compiler meshdir="in"/><asset><mesh name="p" file="pipe.stl"/></asset>',
    "a large file": '<asset><mesh name="p" file="large.stl"/></asset>', "comments": 10**6 * "<!--",
    "prefixes": "".join(f"<p{k}:b/>" for k in range(20_000)), "elements": 60_000 * "<a/>",
}
"""What an arm's file is given, in which MuJoCo would read or make more than there is room for."""


@pytest.mark.parametrize("name", HUGE)
def test_what_mujoco_would_make_without_bound_is_refused(name: str, tmp_path: Path) -> None:
    """Before it does; of a bare & in the file no less."""
    path = write_arm(tmp_path / "arm.xml", 6)
    path.write_text(path.read_text().replace("<mujoco>", f"<mujoco model='a & b'>{HUGE[name]}", 1))
    (tmp_path / "more.xml").write_text(f"<mujoco>{HUGE['copies']}</mujoco>")
    (tmp_path / "few.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    (tmp_path / "in").mkdir()
    for place in (tmp_path, tmp_path / "in") if name != "a pipe in a folder" else (tmp_path / "in",):
        os.mkfifo(place / "pipe.stl")
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(10**10)
    assert re.match(rf"{tmp_path}.*(accepted: |not XML)", handle(lambda: read_arm(path))[1])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("examples", [5, pytest.param(120, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", KINDS)
def test_a_damaged_file_is_read_or_refused(name: str, examples: int, tmp_path: Path) -> None:
    (read, change), path = KINDS[name], write_file(tmp_path, name)
    content = path.read_bytes()
    assert not handle(lambda: read(path))[1]
    fuzz(st.one_of(change(content), damaged(content), changed_texts(content)), examples,
         lambda changed: (path.write_bytes(changed), read(path)))
