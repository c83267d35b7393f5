"""What a MuJoCo scene looks like, without its mechanics: stored in a recording, and built again for its film."""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

import mpm
from mpm.array_files import parse_arrays
from robosim.base.errors import ConfigError
from robosim.recordings.header import BodyEntry
from robosim.rendering.body_shapes import SHOWN_GROUPS

VIEW = {"pos", "mode", "targetbodyid", "bodyid"}
STORED = {
    "geom": {"bodyid", "type", "dataid", "matid", "pos", "quat", "size", "rgba", "group"},
    "mesh": {"vertadr", "vertnum", "faceadr", "facenum", "normaladr", "normalnum", "texcoordadr", "texcoordnum", "vert",
             "face", "facenormal", "facetexcoord", "normal", "texcoord"},
    "hfield": {"adr", "nrow", "ncol", "size", "data"},
    "mat": {"rgba", "emission", "specular", "shininess", "reflectance", "metallic", "roughness", "texuniform",
            "texrepeat", "texid"},
    "tex": {"type", "height", "width", "nchannel", "adr", "data"},
    "light": VIEW | {"dir", "type", "castshadow", "active", "attenuation", "cutoff", "exponent", "ambient", "diffuse",
                     "specular", "bulbradius", "intensity", "range"},
    "cam": VIEW | {"quat", "fovy"},
}
"""Arrays of a model that are stored: their names' beginnings and ends."""
ENUMS = {"mode": mujoco.mjtCamLight, "light_type": mujoco.mjtLightType, "tex_type": mujoco.mjtTexture,
         "geom_type": mujoco.mjtGeom}


def pack_appearance(model: mujoco.MjModel) -> bytes:
    """Return meshes, materials, textures, lights, cameras and visual settings of a model as bytes."""
    arrays = {f"{kind}_{name}": getattr(model, f"{kind}_{name}") for kind, names in STORED.items() for name in names}
    parts = {part: getattr(model.vis, part) for part in dir(model.vis) if part[0].islower()}
    visual = {part: {name: np.asarray(getattr(value, name)).tolist() for name in dir(value) if name[0] != "_"}
              for part, value in parts.items()}
    described = {"visual": visual, "extent": model.stat.extent, "centre": model.stat.center.tolist(),
                 "bodies": [body_name(model, k) for k in range(model.nbody)],
                 "cameras": [model.camera(k).name for k in range(model.ncam)]}
    stream = io.BytesIO()
    np.savez(stream, described=np.frombuffer(json.dumps(described).encode(), np.uint8), **arrays)
    return stream.getvalue()


def build_appearance(content: bytes, bodies: Sequence[BodyEntry], path: Path) -> mujoco.MjSpec:
    """Build a scene without mechanics, in which those of the bodies that move are mocap bodies, in their order.
    path: of the recording, for messages. Raises ConfigError for a damaged one."""
    try:
        return _build(content, bodies, path)
    except (mpm.InvalidValue, ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        raise ConfigError(f"{path}: damaged: what its scene looks like: {error}; record the run again") from None


def _build(content: bytes, bodies: Sequence[BodyEntry], path: Path) -> mujoco.MjSpec:
    model: Any = SimpleNamespace(**parse_arrays(io.BytesIO(content), path))
    described = json.loads(model.described.tobytes())
    spec = mujoco.MjSpec()
    for part, values in described["visual"].items():
        for name, value in values.items():
            if value != [] and hasattr(getattr(spec.visual, part), name):
                setattr(getattr(spec.visual, part), name, value)
    spec.stat.extent, spec.stat.center = described["extent"], described["centre"]
    for entry in bodies:
        if entry.name != "world":
            spec.worldbody.add_body(name=entry.name, mocap=entry.moves, pos=entry.position, quat=entry.quaternion)
    spec.worldbody.add_body(name="drawn last")
    _add_materials(spec, model)
    names = described["bodies"]
    known = {entry.name for entry in bodies} | {"world"}
    for k in range(len(model.geom_type)):
        if model.geom_group[k] in SHOWN_GROUPS and names[model.geom_bodyid[k]] in known:
            name = names[model.geom_bodyid[k]]
            _add_geom(spec, model, k, "drawn last" if name == "world" else name)
    for kind, count in (("light", len(model.light_mode)), ("cam", len(model.cam_mode))):
        for k in range(count):
            body = spec.body(names[getattr(model, f"{kind}_bodyid")[k]])
            target = getattr(model, f"{kind}_targetbodyid")[k]
            view = body.add_light() if kind == "light" else body.add_camera(name=described["cameras"][k])
            view.targetbody = names[target] if target >= 0 else ""
            for name in STORED[kind] - {"bodyid", "targetbodyid"}:
                _set(view, model, kind, name, k)
    return spec


def viewed_bodies(model: mujoco.MjModel) -> set[int]:
    """Return the bodies that lights and cameras are fixed to, or look at."""
    return {int(k) for k in (*model.cam_bodyid, *model.cam_targetbodyid, *model.light_bodyid,
                             *model.light_targetbodyid) if k >= 0}


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body in recordings."""
    return model.body(body).name or f"body_{body}"


def _set(element: Any, model: Any, kind: str, name: str, k: int) -> None:
    """Set an attribute of a specification's element from the k-th entry of an array."""
    value = getattr(model, f"{kind}_{name}")[k]
    value = value.tolist() if value.ndim else value.item()
    enum = ENUMS.get(f"{kind}_{name}", ENUMS.get(name))
    setattr(element, name, value if enum is None else enum(value))


def _add_materials(spec: mujoco.MjSpec, model: Any) -> None:
    for k in range(len(model.tex_type)):
        texture = spec.add_texture(name=f"texture_{k}")
        for name in ("type", "height", "width", "nchannel"):
            _set(texture, model, "tex", name, k)
        size = texture.height * texture.width * texture.nchannel
        texture.data = model.tex_data[model.tex_adr[k] :][:size].tobytes()
    for k in range(len(model.mat_rgba)):
        material = spec.add_material(name=f"material_{k}")
        for name in STORED["mat"] - {"texid"}:
            _set(material, model, "mat", name, k)
        for role, texture in enumerate(model.mat_texid[k]):
            if texture >= 0:
                material.textures[role] = f"texture_{texture}"


def _add_geom(spec: mujoco.MjSpec, model: Any, k: int, body: str) -> None:
    geom, data = spec.body(body).add_geom(contype=0, conaffinity=0), int(model.geom_dataid[k])
    for name in ("type", "pos", "quat", "size", "rgba", "group"):
        _set(geom, model, "geom", name, k)
    if model.geom_matid[k] >= 0:
        geom.material = f"material_{model.geom_matid[k]}"
    if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
        geom.meshname = f"mesh_{data}"
        if spec.mesh(geom.meshname) is None:
            _add_mesh(spec, model, data)
    elif geom.type == mujoco.mjtGeom.mjGEOM_HFIELD:
        geom.hfieldname = f"field_{k}"
        rows, columns = int(model.hfield_nrow[data]), int(model.hfield_ncol[data])
        spec.add_hfield(name=geom.hfieldname, nrow=rows, ncol=columns, size=model.hfield_size[data].tolist(),
                        userdata=model.hfield_data[model.hfield_adr[data] :][: rows * columns].tolist())


def _add_mesh(spec: mujoco.MjSpec, model: Any, k: int) -> None:
    def part(array: str, kind: str) -> list[float]:
        first, count = getattr(model, f"mesh_{kind}adr")[k], getattr(model, f"mesh_{kind}num")[k]
        return getattr(model, f"mesh_{array}")[first : first + count].ravel().tolist()

    mesh = spec.add_mesh(name=f"mesh_{k}", uservert=part("vert", "vert"), userface=part("face", "face"),
                         usernormal=part("normal", "normal"), userfacenormal=part("facenormal", "face"),
                         inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    if model.mesh_texcoordnum[k] > 0:
        mesh.usertexcoord, mesh.userfacetexcoord = part("texcoord", "texcoord"), part("facetexcoord", "face")
