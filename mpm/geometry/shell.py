"""Thin shells: a mid-surface with a thickness far below a cell, and particles on both sides."""

import copy
from collections.abc import Hashable

import numpy as np
import trimesh

from mpm.backend import once, put, ti
from mpm.errors import InvalidValue
from mpm.geometry.distance_cache import kept_lattice
from mpm.geometry.mesh_distance import passage_width, sheet_distances
from mpm.geometry.sampled_sdf import trilinear, trilinear_back
from mpm.geometry.sdf import MAX_LATTICE
from mpm.geometry.shape import Shape, digest

SIDE_BAND = 2.7
"""Cells from the mid-surface within which a node can share a stencil with a particle on the other side: 1.5 sqrt(3)."""
LATTICE_STEP = 0.2  # cells between the points of the lattice, where the user gives no spacing
SHELL_FACE = 1.01
"""Cells in front of a shell's face within which a node counts as on it. A free node nearer than a cell lacks the
pressure of what would lie beyond it: it crushes the layer before the face, which then drives the water there upwards,
and in 2 s such a circulation takes 5 % of a gate's thrust. With this the thrust is right to 0.3 %."""
LEAST_FACE = 0.5
"""Least cells of this kind, as at solids: with 0.01 the thrust of water on a ball is 13 % too small."""
LEAST_SLOPE = 0.3
"""Slope of the distance below which the normal is that of the lattice points about: on the diagonal of an inner edge
the distance does not grow to the sides that a lattice's cell sees, and without a normal sand would leak there."""
FAR = 1.0  # distance [m] outside the lattice


class Shell(Shape):
    """A thin wall: signed distance to a mid-surface with a thickness; it has two sides up to its edge (rim)."""

    is_thin = True

    def __init__(self, mesh: trimesh.Trimesh, thickness: float, spacing: float | None, behind: float = 0.0,
                 face_cells: float = SHELL_FACE) -> None:
        self.mesh, self.thickness, self.wanted_spacing, self.behind = mesh, float(thickness), spacing, float(behind)
        self.face_cells = float(face_cells)  # cells in front of the face within which nodes are in contact
        self.extent = float(np.linalg.norm(mesh.vertices, axis=1).max()) + self.behind
        """Radius [m] of a ball about the frame's origin that contains the surface."""
        self.radius = self.extent
        self.passage = passage_width(mesh) - self.thickness
        self.values = self.sided = None

    @classmethod
    def from_mesh(cls, mid_surface: trimesh.Trimesh, thickness: float, spacing: float | None = None, *,
                  behind: bool = False, face_cells: float = SHELL_FACE) -> "Shell":
        """Make a shell of `thickness` [m] about a surface, open or closed; behind: of which it is the front face.

        spacing: [m] of the lattice of its distances, or None: a fifth of the grid's cell, which places a smooth surface
        to a thousandth of the cell. face_cells: cells in front of the shell's face within which nodes are in contact
        with it, from LEAST_FACE to SHELL_FACE; fewer displace less of a fluid, and hold it less firmly.

        Raises InvalidValue for a thickness that is not positive, face_cells out of range or a surface whose faces wind
        inconsistently."""
        if not thickness > 0 or (spacing is not None and not spacing > 0):
            raise InvalidValue(f"Shell: thickness = {thickness} m, spacing = {spacing} m; accepted: positive lengths")
        if not LEAST_FACE <= face_cells <= SHELL_FACE:
            raise InvalidValue(f"Shell: face_cells = {face_cells}; accepted: {LEAST_FACE} to {SHELL_FACE}")
        if len(mid_surface.faces) == 0:
            raise InvalidValue("Shell: the mid-surface has no faces")
        surface = trimesh.Trimesh(mid_surface.vertices, mid_surface.faces, process=True)
        shared = np.unique(surface.edges_sorted, axis=0, return_counts=True)[1]
        if not surface.is_winding_consistent or shared.max() > 2:
            raise InvalidValue("Shell: neighbouring faces of the mid-surface wind in opposite ways, or three share "
                               "an edge; a sheet has two sides: turn faces over, or make several shells")
        return cls(surface, thickness, spacing, 0.5 * thickness if behind else 0.0, face_cells)

    def signature(self) -> Hashable:
        """Return what two shells share that kernels cannot tell apart, in a grid of one cell."""
        return (type(self), self.thickness, self.wanted_spacing, self.behind, self.face_cells,
                digest(np.asarray(self.mesh.vertices)), digest(np.asarray(self.mesh.faces)))

    def lay_out(self) -> None:
        """Do nothing: a shell is laid out for a cell, by `bake`."""

    def bake(self, cell: float) -> "Shell":
        """Return the shell with its distances near the surface computed, for cells of `cell` [m]."""
        ready = copy.copy(self)
        ready._bake(cell)
        return ready

    def _bake(self, cell: float) -> None:
        band = SIDE_BAND * cell + self.behind
        self.spacing = self.wanted_spacing or LATTICE_STEP * cell
        self.radius = self.extent + band
        lower = self.mesh.bounds[0] - band
        shape = np.ceil((self.mesh.bounds[1] + band - lower) / self.spacing).astype(int) + 1
        if np.prod(shape.astype(float)) > MAX_LATTICE:
            raise InvalidValue(f"Shell: {tuple(shape)} lattice points; give a spacing above {self.spacing} m")
        self.lower, self.shape = tuple(float(c) for c in lower), tuple(int(n) for n in shape)
        kept = kept_lattice([self.mesh], lower, self.spacing, self.shape, {"values": np.float32, "sided": np.int8},
                            lambda: dict(zip(("values", "sided"), sheet_distances(
                                self.mesh, lower, self.spacing, self.shape, band), strict=True)))
        self.host = kept["values"] + np.float32(self.behind)
        self.values = ti.field(ti.f32, self.shape)
        put(self.values, self.host)
        self.sided = ti.field(ti.i8, self.shape)
        put(self.sided, kept["sided"])

    def nearest_normals(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _foot, distance, face = trimesh.proximity.closest_point(self.mesh, points)
        return self.mesh.face_normals[face], distance

    @ti.func
    def least_distance(self, y):
        """Return the distance [m] of y (3,) from the box of the lattice, beyond which the shell touches no node."""
        low = ti.Vector([self.lower[d] for d in range(3)])
        edge = ti.Vector([(self.shape[d] - 1) * self.spacing for d in range(3)])
        return ti.max(ti.max(low - y, y - low - edge), 0.0 * y).norm()

    @ti.func
    def at(self, y):
        """Return the normal towards the positive side, signed distance [m], and whether there are sides at y (3,)."""
        u = ti.Vector([(y[d] - self.lower[d]) / self.spacing for d in range(3)])
        n = y * 0.0
        phi = y[0] * 0.0 + FAR
        sided = 0
        shape = ti.static(self.shape)
        if u.min() >= 0 and u[0] < shape[0] - 1 and u[1] < shape[1] - 1 and u[2] < shape[2] - 1:
            c = ti.cast(u, ti.i32)
            f = u - c
            s = [[[once(self.values[c[0] + i, c[1] + j, c[2] + k]) for k in range(2)] for j in range(2)]
                 for i in range(2)]
            phi, n = trilinear(s, f, y)
            nearest = ti.cast(u + 0.5, ti.i32)
            if n.norm() < ti.static(LEAST_SLOPE * self.spacing):
                for d in ti.static(range(3)):
                    e = ti.Vector([int(c == d) for c in range(3)])
                    n[d] = self.values[ti.min(nearest[d] + 1, shape[d] - 1) * e + nearest * (1 - e)] \
                        - self.values[ti.max(nearest[d] - 1, 0) * e + nearest * (1 - e)]
            n = n / n.norm(1e-12)
            sided = ti.cast(self.sided[nearest], ti.i32)
        return n, phi, sided

    @ti.func
    def is_within(self, y, reach):
        """Return whether one of its faces is nearer to y than reach [m]."""
        _, phi, _sided = self.at(y)
        return ti.abs(phi) < reach + 0.5 * self.thickness

    @ti.func
    def at_back(self, y, normal_bar, phi_bar, real: ti.template()):
        """Return the adjoint of y, where `at` has found a distance."""
        u = ti.Vector([(y[d] - self.lower[d]) / self.spacing for d in range(3)])
        c = ti.max(ti.min(ti.cast(u, ti.i32), ti.Vector([self.shape[d] - 2 for d in range(3)])), 0)
        s = [[[once(self.values[c[0] + i, c[1] + j, c[2] + k]) for k in range(2)] for j in range(2)] for i in range(2)]
        return trilinear_back(s, u - c, y, normal_bar, phi_bar, LEAST_SLOPE * self.spacing) / self.spacing
