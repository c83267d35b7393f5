"""Specifications of MuJoCo's models: finding, reading, compiling, and places in them."""

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mpm import Pose
from robosim.config.resources import folder
from robosim.errors import ConfigError, UnknownName


def read_model(path: Path) -> mujoco.MjSpec:
    """Read an MJCF or URDF file, without its keyframes and gravity compensation; all bodies have names.

    Raises ConfigError with MuJoCo's reason for what cannot be read or compiled.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; accepted: a model of MuJoCo (MJCF) or a URDF")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # else a URDF loses its root and the frames at its flange
        for number, body in enumerate(spec.bodies):
            body.name = body.name or f"{path.stem}_body_{number}"
            body.gravcomp = 0.0  # the servo compensates gravity
        for key in list(spec.keys):
            spec.delete(key)
        spec.copy().compile()
    except ValueError as error:
        raise ConfigError(f"{path}: cannot be read as a model: {' '.join(str(error).split())}") from None
    return spec


def bundled_parts(place: str) -> list[str]:
    """Return the names of parts below models/; place: pattern of their files, as robots/*/arm.yaml."""
    return sorted(path.parent.name for path in folder("models").glob(place))


def find_part(what: str, name: str, place: str, others: Sequence[str] = ()) -> Path:
    """Return the file of a part by its name, or a .yaml file of one's own.

    what: its key in a configuration; place: as of `bundled_parts`; others: names that are no files. Raises ConfigError,
    UnknownName.
    """
    accepted = [*bundled_parts(place), *others]
    if not name.endswith((".yaml", ".yml")):
        if name not in accepted:
            raise UnknownName(what, name, accepted, "or the path of a .yaml file of your own")
        return folder("models") / place.replace("*", name)
    if not Path(name).is_file():
        raise ConfigError(f"{what} {name}: no such file; accepted: a .yaml file of your own, or one of "
                          f"{', '.join(accepted)}")
    return Path(name)


@contextlib.contextmanager
def quiet_attachment() -> Iterator[None]:
    """Suppress MuJoCo's warnings about attaching with an empty prefix, and a part with options of its own.

    A laboratory's names of joints and bodies are kept; names that occur twice are an error of `compile_spec`. The
    options that hold are those of the scene.
    """
    mujoco.set_mju_user_warning(lambda text: None)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*prefix.*|Attach conflict.*")
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(None)


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification; raises ConfigError with MuJoCo's reason where it cannot be."""
    with quiet_attachment():
        try:
            return spec.compile()
        except ValueError as error:
            raise ConfigError(f"the scene cannot be compiled: {' '.join(str(error).split())}") from None


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
