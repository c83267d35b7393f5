"""URDF files as ROS packages have them: meshes by package, meshes of equal names, speeds, continuous joints."""

import os
import re
import warnings
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import mujoco

from robosim.base.errors import ConfigError, ModelNote
from robosim.base.input_files import read_text

MAX_TEXT = 50_000_000
READABLE = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""


def parse_model(path: Path) -> ET.Element:
    """Parse an MJCF or URDF file; raises ConfigError for what is not XML."""
    try:  # MuJoCo takes comments with -- in them, which XML does not
        return ET.fromstring(re.sub("<!--.*?-->", "", read_text(path, MAX_TEXT), flags=re.DOTALL))
    except ET.ParseError as error:
        raise ConfigError(f"{path}: cannot be read as a model: it is not XML: {error}") from None


def read_urdf(root: ET.Element, path: Path, packages: Mapping[str, str]) -> mujoco.MjSpec:
    """Read a parsed URDF with its meshes wherever they lie; packages: name -> folder. Raises ConfigError, ValueError.

    Visual shapes are left out unless <mujoco> in the file says discardvisual="false" and MuJoCo reads their meshes."""
    for kind in ("link", "joint"):
        names = Counter(element.get("name", "") for element in root.findall(kind))
        if (double := next((name for name, count in names.items() if count > 1), None)) is not None:
            raise ConfigError(f"{path}: {kind} {double!r} is there twice; accepted: a name for each")
    for joint in root.findall("joint"):
        if (mimic := joint.find("mimic")) is not None and mimic.get("joint") not in names:
            raise ConfigError(f"{path}: joint {joint.get('name')!r} mimics {mimic.get('joint')!r}, which is no joint; "
                              f"accepted: one of {', '.join(names)}")
    compiler = root.find("mujoco/compiler")
    own = {} if compiler is None else compiler.attrib
    folder, found, are_kept, is_bare = path.parent / own.pop("meshdir", ""), dict[str, Path](), \
        own.get("discardvisual") == "false", False
    own.pop("strippath", None)
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            mesh, is_seen = shape.find("geometry/mesh"), shape.tag == "visual"
            file = None if mesh is None or (is_seen and not are_kept) else \
                locate_mesh(mesh.get("filename", ""), folder, packages, path)
            is_readable = file is None or file.suffix.lower() in READABLE
            if is_seen and not (are_kept and is_readable):
                link.remove(shape)
                is_bare = True
            elif not is_readable:
                raise ConfigError(f"{path}: link {link.get('name')}: collision mesh {file}; accepted: "
                                  f"{', '.join(READABLE)}, in metres; convert it")
            elif mesh is not None and file is not None:
                mesh.set("filename", _unique_name(file, found))
    if is_bare:
        warnings.warn(ModelNote(f"{path}: shapes that are only seen (visual) are left out; pictures show those that "
                                f"collide"), stacklevel=2)
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.strippath = False
    for mesh in spec.meshes:
        mesh.file = str(found[mesh.file])
    return spec


def _unique_name(file: Path, found: dict[str, Path]) -> str:
    """Enter a file under a name that no other file has: MuJoCo names a mesh after it, and reads equal names once."""
    name = next((name for name, other in found.items() if other == file), "")
    stem = file.stem
    while not name or found.setdefault(name, file) != file:
        name, stem = stem + file.suffix, stem + "_"
    return name


def locate_mesh(address: str, folder: Path, packages: Mapping[str, str], path: Path) -> Path:
    """Find the file of a mesh's address in a URDF; raises ConfigError with the places where it was looked for.

    folder: what plain names are relative to; packages: name -> folder, before those that are found."""
    scheme, mark, rest = address.partition("://")
    name, _, inner = rest.partition("/")
    if not mark:
        places = [folder / address, folder / Path(address).name]
    elif scheme == "file":
        places = [Path(rest)]
    elif scheme in ("package", "model"):
        places = [root / inner for root in package_folders(name, packages, path)]
    else:
        places = []
    found = next((place for place in places if place.is_file()), None)
    if found is not None:
        return found.resolve()
    looked = f"not found as {' or '.join(map(str, places))}" if places else (
        f"no folder of package {name} beside or above {path}, nor in ROS_PACKAGE_PATH = "
        f"{os.environ.get('ROS_PACKAGE_PATH', '')!r}")
    raise ConfigError(f"{path}: mesh {address}: {looked}; accepted: package://, model://, file:// or a path of a file, "
                      f"and the key packages: {{{name or 'NAME'}: FOLDER}} for packages elsewhere")


def package_folders(name: str, packages: Mapping[str, str], path: Path) -> Iterator[Path]:
    """Yield the folders that may be a ROS package: that of the key, beside or above the file, of the environment."""
    if name in packages:
        yield Path(packages[name])
        return
    for above in path.resolve().parents:
        manifest = read_text(above / "package.xml") if (above / "package.xml").is_file() else ""
        if above.name == name or f"<name>{name}</name>" in "".join(manifest.split()):
            yield above
        if (above / name).is_dir():
            yield above / name
    for place in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield from (root for root in (Path(place) / name, Path(place)) if root.name == name and root.is_dir())


def read_speeds(path: Path) -> tuple[dict[str, float], set[str]]:
    """Return the speed limits above zero [rad/s], [m/s] of a URDF's joints, and the names of the continuous ones."""
    joints = {joint.get("name", ""): joint for joint in parse_model(path).findall("joint")}
    speeds = {}
    for name, joint in joints.items():
        limit = joint.find("limit")
        text = "0" if limit is None else limit.get("velocity", "0")
        try:
            speeds[name] = float(text)
        except ValueError:
            raise ConfigError(f"{path}: joint {name}: velocity = {text!r}; accepted: a number [rad/s], [m/s]") from None
    return ({name: speed for name, speed in speeds.items() if 0.0 < speed < float("inf")},
            {name for name, joint in joints.items() if joint.get("type") == "continuous"})
