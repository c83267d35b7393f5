"""URDF files as ROS packages have them: meshes by package, meshes of equal names, speeds, continuous joints."""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np

from robosim.base.errors import ConfigError, note
from robosim.base.input_files import read_text

READABLE = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""


def parse_model(path: Path) -> ET.Element:
    """Parse an MJCF or URDF file; raises ConfigError for what is not XML."""
    try:  # MuJoCo takes comments with -- in them, which XML does not
        return ET.fromstring(re.sub("<!--.*?-->", "", read_text(path, 50_000_000), flags=re.DOTALL))
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
            manifest.is_file() and f"<name>{name}</name>" in "".join(read_text(manifest).split()))]
    for place in places:
        if place.is_file():
            return place.resolve()
    raise ConfigError(f"{path}: mesh {address}: not found" + "".join(f", not as {place}" for place in places) +
                      "; accepted: a path, file://PATH, or package://NAME/PATH with a folder NAME beside or above the "
                      "URDF, in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH, or of the key packages: {NAME: FOLDER}")


def read_speeds(path: Path) -> tuple[dict[str, float], set[str]]:
    """Return the speed limits above zero [rad/s], [m/s] of a URDF's joints, and the names of the continuous ones."""
    speeds, root = dict[str, float](), parse_model(path)
    for joint in root.findall("joint"):
        name, limit = joint.get("name", ""), joint.find("limit")
        text = "0" if limit is None else limit.get("velocity", "0")
        try:
            speeds[name] = float(text)
        except ValueError:
            raise ConfigError(f"{path}: joint {name}: velocity = {text!r}; accepted: a number [rad/s], [m/s]") from None
    return ({name: speed for name, speed in speeds.items() if 0.0 < speed < np.inf},
            {joint.get("name", "") for joint in root.findall("joint[@type='continuous']")})
