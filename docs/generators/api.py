"""The API reference: one autodoc directive for each public name, in groups."""

import importlib
import inspect
from typing import Any

MPM_GROUPS = {
    "Session": ["init"],
    "Scene": ["Grid", "Walls", "Body", "Collider", "sample_box", "sample_mesh"],
    "Materials": [],
    "Shapes": ["Sdf", "Shell", "Region"],
    "Solver": ["Solver", "Batch", "Features"],
    "Gradients": ["Rollout"],
    "Observations": ["Diagnostics", "Sample", "RegionCounter", "Counts"],
    "Poses, twists, wrenches": ["Pose", "Twist", "Wrench"],
}
"""Order of the names of mpm on its page; an empty group has what the folder of this name defines. Names that are not
listed follow in groups of their own."""
SHAPES = ["mpm.geometry.primitives.Plane", "mpm.geometry.primitives.Sphere", "mpm.geometry.primitives.Box",
          "mpm.geometry.primitives.Capsule", "mpm.geometry.primitives.Cylinder", "mpm.geometry.primitives.Ellipsoid",
          "mpm.geometry.height_field.HeightField", "mpm.geometry.union.Union"]
"""Shapes that `mpm.Sdf` makes; their pages show how to make them, not the functions that kernels call."""
FOREIGN = "tuple, dict, BaseException, Warning, BaseModel, Env, VecEnv"
"""Bases whose own members are left out."""
HIDDEN = "count, index, model_config, stress, stress_back, return_mapping, return_mapping_back"
"""Members that are left out: those of named tuples and of pydantic's models, and what only kernels call."""
ALSO_HIDDEN = {"RegionCounter": ", accumulate, list_particles, position, distance, contains, count_near, probe_points",
               "Sample": ", take", "Region": ", row"}
"""Class -> further members that only kernels call."""
POLICIES = ["policies.learners.vec_env.SB3VecEnv", "policies.learning.presets.Preset",
            "policies.learning.presets.load_preset", "policies.methods.method.Method"]
"""What programs use of policies besides its commands."""


def directive(path: str, value: Any) -> str:
    """The autodoc directive of one object."""
    if inspect.isclass(value):
        hidden = HIDDEN + ALSO_HIDDEN.get(value.__name__, "")
        return f".. autoclass:: {path}\n   :members:\n   :inherited-members: {FOREIGN}\n   :exclude-members: {hidden}\n"
    return f".. autofunction:: {path}\n" if callable(value) else f".. autodata:: {path}\n"


def group(title: str, names: list[tuple[str, Any]]) -> str:
    """A heading and its objects."""
    body = "\n".join(directive(path, value) for path, value in names)
    return f"## {title}\n\n```{{eval-rst}}\n{body}```\n"


def is_error(value: Any) -> bool:
    """Whether an object is an exception or a warning."""
    return inspect.isclass(value) and issubclass(value, Exception)


def package_page(package: str, groups: dict[str, list[str]]) -> str:
    """All names in a package's `__all__`, errors last."""
    module = importlib.import_module(package)
    folder_of = {name: getattr(module, name).__module__.split(".")[1] for name in module.__all__}
    groups = {title: names or [name for name in module.__all__ if folder_of[name] == title.lower()]
              for title, names in groups.items()}
    rest = [name for name in module.__all__ if name not in {n for names in groups.values() for n in names}]
    sections = {title: [name for name in names if name in module.__all__] for title, names in groups.items()}
    sections["Further names"] = [name for name in rest if not is_error(getattr(module, name))]
    sections["Errors and warnings"] = [name for name in rest if is_error(getattr(module, name))]
    return "\n".join(group(title, [(f"{package}.{name}", getattr(module, name)) for name in names])
                     for title, names in sections.items() if names)


def mpm_page() -> str:
    """The field."""
    shapes = "\n".join(f".. autoclass:: {path}\n" for path in SHAPES)
    return f"{package_page('mpm', MPM_GROUPS)}\n## Analytic shapes\n\nThe classes behind `mpm.Sdf.plane`, " \
           f"`mpm.Sdf.sphere` and so on.\n\n```{{eval-rst}}\n{shapes}```\n"


def robosim_page() -> str:
    """The coupling, rehearsals, and the environments by their pages."""
    from robosim.envs import BUNDLED
    from robosim.envs.grain_env import GrainEnv

    public = package_page("robosim", {"Rehearsals": ["Rehearsal", "Result", "RehearsalConfig"],
                                      "Coupling": ["GranularPlugin"],
                                      "Scenes": ["Container", "GrainRenderer", "Mp4Writer"]})
    envs = group("Environments", [("robosim.envs.grain_env.GrainEnv", GrainEnv)])
    pages = importlib.import_module("robosim.envs.sub_tasks")
    docs = {name: (inspect.getdoc(getattr(pages, name)) or "").replace("\n## ", "\n#### ") for name in BUNDLED}
    texts = "\n".join(f"### robosim/{name}-v0\n\n{text}\n" for name, text in docs.items())
    return f"{public}\n{envs}\n{texts}"


def policies_page() -> str:
    """Learning."""
    named = []
    for path in POLICIES:
        module, name = path.rsplit(".", 1)
        named.append((path, getattr(importlib.import_module(module), name)))
    return group("Learning", named)
