"""Materials that episodes are made in, by label."""

from robosim.config.materials import MaterialConfig, load_material, overridden

MATERIALS: dict[str, tuple[str, dict[str, float]]] = {
    **{name: (name, {}) for name in ("salt", "sugar", "flour", "sand")},
    "salt, a third of E": ("salt", {"E": 5e4}), "salt, 2.5 times E": ("salt", {"E": 3.75e5}),
    "salt, half as dense": ("salt", {"density": 608.5}), "salt, twice as dense": ("salt", {"density": 2434.0}),
    "salt, 10 deg smoother": ("salt", {"friction_angle_deg": 23.0}),
    "salt, 10 deg rougher": ("salt", {"friction_angle_deg": 43.0}),
    "salt, cohesion 30 Pa": ("salt", {"cohesion": 30.0}), "salt, cohesion 100 Pa": ("salt", {"cohesion": 100.0}),
    "salt, Poisson's ratio 0.35": ("salt", {"nu": 0.35}),
}
"""Label -> (material, numbers in place of its own). None is so stiff for its density that the sub-tasks' time step
would be too large."""


def find_material(label: str) -> MaterialConfig:
    """Return the material of a label, or of a name or file of a material; raises UnknownName, ConfigError."""
    name, numbers = MATERIALS.get(label, (label, {}))
    return overridden(load_material(name), numbers)
