"""Where signed distances come from: one name for each kind of solid."""

import numpy as np
import trimesh

from mpm.errors import InvalidValue
from mpm.geometry.distance_cache import kept_lattice
from mpm.geometry.height_field import HeightField
from mpm.geometry.mesh_distance import passage_width, signed_distances
from mpm.geometry.primitives import Box, Capsule, Cylinder, Ellipsoid, Plane, Sphere
from mpm.geometry.sampled_sdf import Lattice
from mpm.geometry.shape import check_sizes
from mpm.geometry.union import Union

MAX_LATTICE = 40_000_000  # lattice points beyond which a spacing is refused: 160 MB


class Sdf:
    """Constructors of signed-distance shapes."""

    plane, sphere, box, capsule, cylinder, ellipsoid = Plane, Sphere, Box, Capsule, Cylinder, Ellipsoid
    height_field, union = HeightField, Union

    @staticmethod
    def from_mesh(mesh: trimesh.Trimesh | list[trimesh.Trimesh], spacing: float = 1e-3,
                  margin: float = 4e-3) -> Lattice:
        """Return the lattice of the union of closed meshes, with `spacing` [m], and `margin` [m] around them.
        Raises InvalidValue for an open mesh, and for a spacing that needs too many lattice points."""
        check_sizes("Sdf.from_mesh", "spacing", spacing)
        check_sizes("Sdf.from_mesh", "margin", margin)
        parts = mesh if isinstance(mesh, list) else [mesh]
        for part in parts:
            if not part.is_watertight:
                raise InvalidValue("Sdf.from_mesh: the mesh has open edges, and a solid is closed; close it, or make "
                                   "it a thin shell with Shell.from_mesh(mesh, thickness)")
        bounds = np.array([part.bounds for part in parts])
        lower = bounds[:, 0].min(0) - margin
        shape = np.ceil((bounds[:, 1].max(0) + margin - lower) / spacing).astype(int) + 1
        if np.prod(shape.astype(float)) > MAX_LATTICE:
            raise InvalidValue(f"Sdf.from_mesh: {tuple(shape)} lattice points; give a spacing above {spacing} m")
        places = tuple(int(n) for n in shape)
        kept = kept_lattice(parts, lower, spacing, places, {"values": np.float32, "width": np.float64}, lambda: {
            "values": np.min([signed_distances(part, lower, spacing, places) for part in parts], axis=0),
            "width": np.array(min(passage_width(part) for part in parts))})
        lattice = Lattice(kept["values"], lower, spacing)
        lattice.passage = float(kept["width"])
        lattice.parts = parts
        return lattice
