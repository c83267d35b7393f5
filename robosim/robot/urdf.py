"""URDF files as ROS packages have them: meshes by package, meshes of equal names, speeds, continuous joints."""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import mujoco

from robosim.base.errors import ConfigError, note
from robosim.base.input_files import read_text

READABLE = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""


def parse_model(path: Path) -> ET.Element:
    """Parse an MJCF or URDF file, one of xacro expanded; raises ConfigError.
    A bare & and what MuJoCo takes for a comment are read, although they are not XML."""
    text, *others = read_text(path, 50_000_000).split("<!--")  # MuJoCo takes comments with -- in them
    text += "".join(other.partition("-->")[2] for other in others)
    try:
        if path.suffix.lower() == ".xacro" or "<xacro:" in text:
            text = import_module("xacro").process_file(str(path)).toxml()
    except Exception as error:  # expressions of the file are executed
        is_missing = getattr(error, "name", "") == "xacro"
        other = ", or a xacro file after `pip install xacro`" if is_missing else " in a sourced ROS workspace"
        raise ConfigError(f"{path}: xacro: {' '.join(str(error).split())}; accepted: the URDF that `xacro {path.name} "
                          f"> arm.urdf` writes{other}") from None
    undeclared = set(re.findall(r"[<\s]([a-zA-Z_]\w*):\w", text)) - {"xml", "xmlns", *re.findall(r"xmlns:(\w+)=", text)}
    if len(undeclared) > 100:  # XML's readers compare each with all
        raise ConfigError(f"{path}: {len(undeclared)} prefixes that it does not declare; accepted: up to 100")
    declared = "".join(f' xmlns:{name}="{name}"' for name in undeclared)  # ROS asks for none
    text = re.sub(r"&(?!#?\w+;)", "&amp;", text.lstrip())
    try:
        return ET.fromstring(re.sub(r"<(robot|mujoco)(?=[\s>])", rf"<\1{declared}", text, count=1))
    except ET.ParseError as error:
        raise ConfigError(f"{path}: cannot be read as a model: it is not XML: {error}") from None


def read_urdf(root: ET.Element, path: Path, packages: Mapping[str, str]) -> mujoco.MjSpec:
    """Read a parsed URDF with its meshes wherever they lie; packages: name -> folder. Raises ConfigError, ValueError.
    Visual shapes are left out unless <mujoco> in the file says discardvisual="false" and MuJoCo reads their meshes."""
    for kind in ("link", "joint"):
        names = sorted(element.get("name", "") for element in root.findall(kind))
        if double := [name for name, after in pairwise(names) if name == after]:
            raise ConfigError(f"{path}: {kind} {double[0]!r} is there twice; accepted: a name for each")
    for mimic in root.findall("joint/mimic"):
        if mimic.get("joint") not in names:
            raise ConfigError(f"{path}: <mimic> of {mimic.get('joint')!r}; accepted: a joint of {', '.join(names)}")
    own = {} if (compiler := root.find("mujoco/compiler")) is None else compiler.attrib
    folder, own["strippath"] = path.parent / own.pop("meshdir", ""), "false"
    found, left_out = dict[str, Path](), False
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            mesh, is_seen = shape.find("geometry/mesh"), shape.tag == "visual"
            is_read = not is_seen or own.get("discardvisual") == "false"
            if mesh is not None and is_read:
                file = locate_mesh(mesh.get("filename", ""), folder, packages, path)
                is_read = file.suffix.lower() in READABLE
                stem = file.stem + "_"  # MuJoCo reads meshes of equal names once; scaled ones get a number behind it
                while found.setdefault(stem + file.suffix, file) != file:
                    stem += "_"
                mesh.set("filename", stem + file.suffix)
                if not is_read and not is_seen:
                    raise ConfigError(f"{path}: link {link.get('name')}: collision mesh {file}; accepted: "
                                      f"{', '.join(READABLE)}, in metres; convert it")
            if not is_read:
                link.remove(shape)
                left_out = True
    if left_out:
        note(f"{path}: visual shapes are left out; pictures show those that collide")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    for mesh in spec.meshes:
        mesh.file = str(found[mesh.file])
    return spec


def locate_mesh(address: str, folder: Path, packages: Mapping[str, str], path: Path) -> Path:
    """Find the file of a mesh's address in a URDF; raises ConfigError with the places where it was looked for.
    folder: what plain names are relative to; packages: name -> folder. Other packages are folders beside or above the
    URDF, in ROS_PACKAGE_PATH or in share/ of AMENT_PREFIX_PATH, with that name or a package.xml that says it."""
    scheme, mark, rest = address.partition("://")
    name, _, inner = rest.partition("/")
    ros = [Path(place) / below for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
           for place in os.environ.get(variable, "").split(os.pathsep) if place]
    places = [folder / address, folder / Path(address).name] if not mark else [Path(rest)] if scheme == "file" else []
    if scheme in ("package", "model") and name in packages:
        places = [Path(packages[name]) / inner]
    elif scheme in ("package", "model"):
        above = [*path.resolve().parents, *ros]
        roots = [(root, root / "package.xml") for one in above for root in (one, one / name)]
        places = [root / inner for root, manifest in roots if root.name == name or (
            os.path.isfile(manifest) and f"<name>{name}</name>" in "".join(read_text(manifest).split()))]
    for place in places:
        if os.path.isfile(place):  # False for a name that is too long
            return place.resolve()
    raise ConfigError(f"{path}: mesh {address}: " + ", not as ".join(["not found", *dict.fromkeys(map(str, places))]) +
                      "; accepted: a path, file://PATH, or package://NAME/PATH with a folder NAME beside or above the "
                      "URDF, in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH, or of the key packages: {NAME: FOLDER} of a "
                      ".yaml file")


def read_limits(path: Path) -> tuple[dict[str, float], dict[str, float], set[str]]:
    """Return speeds and efforts of a URDF's joints, zero where it has none, and the names of the continuous ones; of an
    MJCF nothing. Raises ConfigError. MuJoCo reads no speeds, and efforts without their sign."""
    limits, root = (dict[str, float](), dict[str, float]()), parse_model(path)
    for joint in root.findall("joint"):
        name, limit = joint.get("name", ""), getattr(joint.find("limit"), "attrib", {})
        for key, values in zip(("velocity", "effort"), limits):
            try:
                values[name] = float(limit.get(key, "0"))
            except ValueError:
                raise ConfigError(f"{path}: joint {name}: {key} = {limit[key]!r}; accepted: a number") from None
    return *limits, {joint.get("name", "") for joint in root.findall("joint[@type='continuous']")}
