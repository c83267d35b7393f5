"""All run-time fields of a scene, typed: what the phases of a substep are handed."""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mpm.backend import is_shared, real_type, thread_count, ti
from mpm.materials.hencky_strain import INTEGRATORS
from mpm.materials.material import Material
from mpm.scene.collider import Collider
from mpm.scene.features import Features
from mpm.scene.grid import GHOST
from mpm.scene.scene import Scene
from mpm.scene.wall_condition import WallCondition
from mpm.scene.walls import conditions_of
from mpm.state.active_blocks import SubstepCounter
from mpm.state.contact_fields import MobileContact, OrificeFields, PenetratingParticles, ShellFields, StaticContact
from mpm.state.ledger import LedgerRows, ledger_rows
from mpm.state.nodes import GridFields
from mpm.state.parameters import Parameters, laws_of
from mpm.state.particles import ParticleFields
from mpm.state.sleepers import Sleepers


@dataclass(frozen=True, eq=False)
class Fields:
    """Run-time fields, and the constants that kernels compile in. A field that no feature asks for is None."""

    features: Features
    particles: ParticleFields
    grid: GridFields
    parameters: Parameters
    laws: tuple[Material, ...]  # one material of each law: what is compiled grows with these, not with the bodies
    wall_conditions: tuple[WallCondition, ...]  # one condition of each class that the walls use
    colliders: tuple[Collider, ...]
    static_contact: StaticContact | None
    shells: ShellFields | None
    orifices: OrificeFields | None
    mobile_nodes: MobileContact | None
    penetrating: PenetratingParticles | None
    sleepers: Sleepers | None
    cell_rates: Any
    """Sums of the particles in the cell that begins at a node: rate of volume [m^3/s] and volume [m^3]."""
    scatter_target: Any
    """Node field that particles scatter to: that of `grid`, or `parts` arrays, one after the other along x."""
    parts: int
    """Arrays that threads scatter to before these are added up; 0: particles scatter to the nodes."""
    cell: float  # dx [m]
    origin: tuple[float, float, float]  # position [m] of node (0, 0, 0)
    cells: tuple[int, int, int]  # cells along each axis, between the walls
    rows: LedgerRows
    substep_counter: SubstepCounter  # numbers of substeps, which active blocks carry

    @property
    def real(self) -> Any:
        """Taichi's type of the field's numbers."""
        return real_type(self.features.precision)

    @property
    def dtype(self) -> type:
        """NumPy's type of the field's numbers."""
        return np.float64 if self.features.precision == "f64" else np.float32

    @property
    def corner(self) -> float:
        """Coordinate [m] of the lower walls relative to node (0, 0, 0), along each axis."""
        return GHOST * self.cell

    @property
    def span(self) -> tuple[float, ...]:
        """Distances [m] between the walls."""
        return tuple(float(n) * self.cell for n in self.cells)

    @property
    def quantum(self) -> tuple[float, ...]:
        """Distances [m] in whose multiples particles move along each axis where they have a `remainder`: the resolution
        of the largest coordinate, so that nothing is rounded."""
        return tuple(float(np.spacing(np.float32((n + GHOST) * self.cell))) for n in self.cells)

    @property
    def logarithm(self) -> Any:
        """Hencky strain of e = b - I, as a Taichi function."""
        return INTEGRATORS[self.features.integrator][0]

    @property
    def exponential(self) -> Any:
        """The inverse of `logarithm`, as a Taichi function."""
        return INTEGRATORS[self.features.integrator][1]

    @property
    def mobile_place(self) -> tuple[int, ...]:
        """Place of each collider among the mobile ones, or -1."""
        mobile = self.features.mobile
        return tuple(mobile.index(i) if i in mobile else -1 for i in range(len(self.colliders)))

    @property
    def stops_later(self) -> bool:
        """Whether particles near moving solids are listed for one thread to stop them."""
        return self.penetrating is not None

    @property
    def boundary_states(self) -> list[OrificeFields]:
        """Boundaries with a state of their own, which is saved and restored with that of the particles."""
        return [] if self.orifices is None else [self.orifices]

    @property
    def is_periodic(self) -> bool:
        """Whether space closes on itself along some axis."""
        return any(self.features.periodic)

    @ti.func
    def world_origin(self):
        """Return the position [m] of node (0, 0, 0) in double precision."""
        return ti.Vector([ti.cast(self.origin[0], ti.f64), ti.cast(self.origin[1], ti.f64),
                          ti.cast(self.origin[2], ti.f64)])


def count_parts(features: Features) -> int:
    """Return the arrays that threads of a CPU scatter to, one each; 0 for one thread, and on a GPU."""
    return 0 if features.serial or is_shared() else thread_count()


def scene_key(scene: Scene, features: Features) -> Hashable:
    """Return what two scenes must share to share fields and kernels: all that is compiled in or gives a size."""
    grid = scene.grid
    return (features, count_parts(features), grid.shape, tuple(grid.cells.tolist()), tuple(grid.origin.tolist()),
            grid.cell, tuple((type(body.material), len(body.positions)) for body in scene.bodies),
            tuple(type(condition) for condition in conditions_of(scene.walls)),
            tuple(collider.sdf.signature() for collider in scene.colliders))


def allocate_fields(scene: Scene, features: Features) -> Fields:
    """Allocate the fields that a scene asks for; inside `backend.allocating`, and with the colliders' own laid out."""
    grid, bodies, colliders, parts = scene.grid, scene.bodies, scene.colliders, count_parts(features)
    precision = features.precision
    particles = ParticleFields(tuple(len(body.positions) for body in bodies), features)
    nodes = GridFields(grid, precision, 2 if features.shells else 1, features.serial, parts,
                       features.solids, len(features.moving_solids))
    target = nodes.nodes
    if parts:
        nx, ny, nz = nodes.nodes.shape
        target = ti.Vector.field(4, real_type(precision), (parts * nx, ny, nz))
    ready = [replace(c, sdf=c.sdf.bake(grid.cell)) for c in colliders]
    shells = None
    if features.shells:
        lists_entering = is_shared() and bool(set(features.shells) & set(features.mobile))
        shells = ShellFields(grid, precision, particles.n_lanes, lists_entering)
    mobile = None
    if features.mobile:
        # how many nodes, of all layers, a ball of a collider's radius can hold
        across = [2.0 * ready[i].sdf.radius / grid.cell + 2.0 for i in features.mobile]
        room = [int(min(nodes.layers * int(n**3), np.prod(nodes.nodes.shape))) for n in across]
        mobile = MobileContact(room, precision, parts, bool(features.orifices))
    penetrating = None
    if not features.serial and set(features.mobile) & set(features.moving_solids):
        penetrating = PenetratingParticles(particles.n_lanes * len(features.moving_solids), max(parts, 1))
    sleepers = Sleepers(nodes, particles.n_packs, len(bodies), precision) if features.sleep else None
    nx, ny, nz = (int(n) for n in grid.cells)
    x, y, z = (float(c) for c in grid.origin)
    return Fields(
        features=features, particles=particles, grid=nodes, laws=tuple(laws_of(bodies)),
        wall_conditions=tuple(conditions_of(scene.walls)), colliders=tuple(ready),
        static_contact=StaticContact(grid, precision) if features.static_colliders else None, shells=shells,
        orifices=OrificeFields(features) if features.orifices else None,
        cell_rates=ti.Vector.field(2, real_type(precision), nodes.nodes.shape) if features.cell_rates else None,
        mobile_nodes=mobile, penetrating=penetrating, sleepers=sleepers,
        parameters=Parameters(len(bodies), len(colliders), precision),
        substep_counter=SubstepCounter(), scatter_target=target, parts=parts, cell=grid.cell, origin=(x, y, z),
        cells=(nx, ny, nz), rows=ledger_rows(len(colliders)))


def fill_fields(fields: Fields, scene: Scene) -> None:
    """Put fields, new or taken over, at the start of a scene."""
    fields.particles.fill(scene.bodies, scene.grid)
    fields.parameters.fill(scene)
    fields.substep_counter.is_listed = False
    if fields.shells is not None:
        fields.shells.fill()
    for boundary in fields.boundary_states:
        boundary.fill(scene.colliders)
