"""Specifications of MuJoCo's models: finding, reading, compiling, and places in them."""

import contextlib
import math
import os
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

import mujoco
import numpy as np

from mpm import Pose
from robosim.base.errors import ConfigError, UnknownName, note
from robosim.robot.urdf import parse_model, read_urdf

MOST = {"elements": 50_000, "copies": 3000, "values": 10_000_000, "bytes": 200_000_000}
"""In a model's files, of its elements' copies, of heights and other values that it makes, and of a mesh or other file.
MuJoCo has no bounds of its own, and is quadratic in bodies: it takes 3 s for as many copies."""
MAKERS = {"replicate": "count", "composite": "count", "flexcomp": "count", "hfield": "nrow|ncol", "mesh": "params",
          "texture": "width|height", "size": "nkey|nuser_.*"}
"""Element that copies others, or makes values -> its attributes that say how many."""
MENAGERIE = "menagerie:"
"""Begin of the name of a model in a local copy of MuJoCo Menagerie."""
BARE = mujoco.MjSpec()
"""Whose defaults are MuJoCo's own: what is added to a laboratory's model must not take those of its classes."""


def read_model(path: Path, packages: Mapping[str, str] | None = None) -> mujoco.MjSpec:
    """Read an MJCF or URDF file, without its keyframes and gravity compensation; all bodies have names.
    packages: folders of ROS packages by name. Raises ConfigError with MuJoCo's reason for what cannot be read."""
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; accepted: a model of MuJoCo (MJCF) or a URDF")
    root = parse_model(path)
    check_size(root, path)
    try:
        with quiet_mujoco() as said:
            spec = read_urdf(root, path, packages or {}) if root.tag == "robot" else mujoco.MjSpec.from_file(str(path))
            if spec.compiler.settotalmass > 0.0:
                raise ConfigError(f"{path}: settotalmass = {spec.compiler.settotalmass:g} would scale the whole scene; "
                                  f"accepted: masses of the bodies, as MuJoCo's saved model has them")
            spec.compiler.fusestatic = False  # else a URDF loses its root and the frames at its flange
            for number, body in enumerate(spec.bodies):
                body.name = body.name or f"{path.stem}_body_{number}"
                body.gravcomp = 0.0  # the servo compensates gravity
            for number, one in enumerate(spec.equalities):
                one.name = one.name or f"{number} of {one.name1} and {one.name2}"
            for key in list(spec.keys):
                spec.delete(key)
            spec.compile()  # a copy would leave out what refers to nothing
    except ConfigError:
        raise
    except (ValueError, RuntimeError) as error:  # the latter of memory that there is not
        raise ConfigError(f"{path}: cannot be read as a model: {' '.join(str(error).split())}") from None
    for text in said:
        note(f"{path}: {' '.join(text.split())}")
    return spec


def check_size(root: ET.Element, path: Path) -> None:
    """Raise ConfigError for a parsed model that would be too large, or that reads a pipe or a device.
    What its files include or attach is part of it."""
    copies, values, attached, names, folders = 0.0, 0.0, dict[Path, float](), set[str](), {path.parent}
    pending: list[tuple[ET.Element, float, tuple[Path, ...]]] = [(root, 1.0, (path.resolve(),))]
    for element, times, within in pending:  # level by level: <compiler> comes before what uses its folders
        tag, file = element.tag, within[-1]
        sizes = [float(number) for key, text in element.items() if re.fullmatch(MAKERS.get(tag, " "), key)
                 for number in re.findall(r"(?<![\w.])0*([1-9]\d*)(?![\w.])", text)]
        if tag in ("mesh", "size"):  # of vertices along an edge; of each of many parts
            sizes = [30.0, max(sizes, default=0.0) ** 2]
        times *= math.prod(sizes) if MAKERS.get(tag) == "count" else 1.0
        copies += times if times > 1.0 else 0.0
        values += math.prod(sizes) if tag in MAKERS else 0.0
        attached[file] = attached.get(file, 0.0) + (times if tag == "attach" else 0.0)
        again = math.prod(max(1.0, number) for number in attached.values())
        for what, number in (("elements", len(pending)), ("copies", copies + (again - 1.0) * len(pending)),
                             ("values", again * values)):
            if number > MOST[what]:
                given = "".join(f' {key}="{text:.30}"' for key, text in element.items())
                raise ConfigError(f"{file}: <{tag}{given:.200}>: {number:.3g} {what}; accepted: up to {MOST[what]}")
        names.update(text for key, text in element.items() if key.startswith("file"))
        if tag == "compiler":
            folders.update(file.parent / element.get(key, "") for key in ("meshdir", "texturedir", "assetdir"))
        pending.extend((child, times, within) for child in element)
        if tag not in ("include", "model"):
            continue
        for part in {Path(os.path.realpath(one / element.get("file", ""))) for one in (*folders, file.parent)}:
            if part in within:
                raise ConfigError(f"{file}: <{tag}> of {part}, which it is in itself; accepted: another file")
            if part not in attached and os.path.isfile(part):
                attached[part] = 0.0
                pending.append((parse_model(part), times, (*within, part)))
    for place in {folder / one for folder in folders for name in names for one in (name, Path(name).name)}:
        if os.path.exists(place) and not os.path.isdir(place) and (
                not os.path.isfile(place) or os.path.getsize(place) > MOST["bytes"]):
            raise ConfigError(f"{path}: {place}: a pipe, a device or too large; accepted: up to {MOST['bytes']} bytes")


def locate_model(name: str, place: Path) -> Path:
    """Return the file of a model that is not ours; raises ConfigError.
    name: a path, relative to a folder `place`; NAME_description, of the package robot_descriptions; or menagerie:FOLDER
    or menagerie:FOLDER/FILE, of a copy of MuJoCo Menagerie in the folder that the variable MUJOCO_MENAGERIE names."""
    if name.startswith(MENAGERIE):
        return find_in_menagerie(name.removeprefix(MENAGERIE))
    if re.fullmatch(r"\w+_description", name) is None:
        return (place / name).resolve()
    try:
        module = import_module(f"robot_descriptions.{name}")
    except ModuleNotFoundError as error:
        missing = "pip install robot_descriptions" if error.name == "robot_descriptions" else "a name of that package"
        raise ConfigError(f"model {name}: of the package robot_descriptions; {missing} is needed") from None
    except Exception as error:  # it fetches by git, which fails in many ways
        raise ConfigError(f"model {name}: robot_descriptions cannot fetch it: {error}") from None
    path = getattr(module, "MJCF_PATH", None) or getattr(module, "URDF_PATH", None)
    if path is None:
        raise ConfigError(f"model {name}: robot_descriptions has neither an MJCF nor a URDF of it; accepted: one with")
    return Path(path)


def find_in_menagerie(name: str) -> Path:
    """Return the file of a model FOLDER or FOLDER/FILE of a local Menagerie; raises ConfigError, UnknownName."""
    root = Path(os.environ.get("MUJOCO_MENAGERIE", ""))
    if not os.environ.get("MUJOCO_MENAGERIE") or not root.is_dir():
        raise ConfigError(f"model {MENAGERIE}{name}: MUJOCO_MENAGERIE = {os.environ.get('MUJOCO_MENAGERIE', '')!r}; "
                          f"accepted: the folder of a copy of MuJoCo Menagerie in that variable of the environment")
    part, _, stem = name.partition("/")
    folders = sorted(path.parent.name for path in root.glob("*/scene.xml"))
    if part not in folders:
        raise UnknownName("model of the Menagerie", part, folders)
    files = sorted(path.stem for path in (root / part).glob("*.xml") if not path.stem.startswith("scene"))
    stem = files[0] if stem == "" and len(files) == 1 else stem
    if stem not in files:
        raise UnknownName(f"model of the Menagerie: {part}/FILE", stem, files)
    return root / part / f"{stem}.xml"


@contextlib.contextmanager
def quiet_mujoco() -> Iterator[list[str]]:
    """Suppress MuJoCo's warnings, which it would append to a file in the working directory, and give their texts.
    Of Python's, those about attaching with an empty prefix, and a part with options of its own: a laboratory's names of
    joints and bodies are kept, names that occur twice are an error of `assembling`, and the options that hold are
    those of the scene."""
    said, before = list[str](), mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*prefix.*|Attach conflict.*")
        try:
            yield said
        finally:
            mujoco.set_mju_user_warning(before)  # one within another leaves it quiet


@contextlib.contextmanager
def assembling() -> Iterator[None]:
    """Attach or compile parts of a scene; raises ConfigError with MuJoCo's reason where they do not fit."""
    with quiet_mujoco():
        try:
            yield
        except ConfigError:
            raise
        except ValueError as error:
            reason = " ".join(str(error).split())
            remedy = "; arm, hand, tool, containers and work cell share their names: rename it in one of the models"
            raise ConfigError(f"the scene cannot be compiled: {reason}{remedy if 'repeated name' in reason else ''}"
                              ) from None


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification; raises ConfigError with MuJoCo's reason where it cannot be."""
    with assembling():
        return spec.compile()


def find_site_pose(spec: mujoco.MjSpec, site: str, body: str) -> Pose:
    """Find the pose of a site in a body's frame, in the compiled model's zero posture."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    T_ws = Pose.from_matrix(data.site(site).xpos, data.site(site).xmat.reshape(3, 3))
    return Pose(data.body(body).xpos.copy(), data.body(body).xquat.copy()).inverse() @ T_ws


def body_ids_below(model: mujoco.MjModel, root: int) -> np.ndarray:
    """Return the indices of a body and of all that hang at it."""
    inside = np.zeros(model.nbody, bool)
    inside[root] = True
    for body in range(root + 1, model.nbody):
        inside[body] = inside[model.body_parentid[body]]
    return np.flatnonzero(inside)


def body_pose(data: mujoco.MjData, body: int) -> Pose:
    """Return the world pose of a body's frame."""
    return Pose(data.xpos[body].copy(), data.xquat[body].copy())
