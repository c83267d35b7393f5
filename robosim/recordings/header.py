"""What a recording says about its scene, before its frames, and which grains lie in its regions."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

import mpm
from robosim.config.bounds import MAX_ENTRIES, FarCoordinate, Intensity, Name, Text
from robosim.config.table import Table

VERSION = 1
Vector3 = tuple[FarCoordinate, FarCoordinate, FarCoordinate]
Quaternion = tuple[FarCoordinate, FarCoordinate, FarCoordinate, FarCoordinate]
LARGEST_HALF = 100.0
"""Half size [m] in place of an infinite one."""


class RegionEntry(Table):
    """A region that counts grains, or the inside of a tool: a box, or an upright cylinder of its own frame."""

    name: Name
    body: Name = ""
    """Body that it moves with; empty: the world."""
    position: Vector3
    """Of its centre, in the frame of the body [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """(w, x, y, z)"""
    half: Vector3
    """Half sizes [m]."""
    round: bool = False
    """Whether it is a cylinder."""
    is_place: bool = True
    """Whether grains in it are where they may be: those in none of these are drawn as spilled."""
    is_marked: bool = False
    """Whether a film marks it on the table."""


class WaypointEntry(Table):
    """A waypoint of the tool."""

    name: Name
    time: float = Field(ge=0.0, le=1e6)
    """At which it is passed [s]."""
    position: Vector3
    """[m]"""


class CurveEntry(Table):
    """A quantity that every frame has a value of."""

    name: Name
    unit: Name = ""
    chart: Name
    """Chart that it is drawn in, with the others of the same name."""


class CameraEntry(Table):
    """A view of the scene."""

    name: Name
    position: Vector3
    target: Vector3
    fov_deg: float = Field(gt=1.0, lt=170.0)
    """Vertical angle [deg]."""


class BodyEntry(Table):
    """A rigid body with its pose in the first frame."""

    name: Name
    moves: bool
    """Whether frames have its pose; otherwise that of here holds."""
    position: Vector3
    quaternion: Quaternion


class RecordingHeader(Table):
    """The scene of a recording."""

    version: int = Field(ge=1, le=1_000_000)
    kind: Name
    """What was recorded: rehearsal, task, plan or scene."""
    title: Text
    caption: Text = ""
    """What pictures of a film say besides the time."""
    command: Text = ""
    commit: Name = ""
    frame_rate: float = Field(gt=0.0, le=1e4)
    """Frames per second of simulated time."""
    grains: int = Field(ge=0, le=100_000_000)
    grain_radius: float = Field(ge=0.0, le=10.0)
    """At which a grain is drawn [m]."""
    colour: tuple[Intensity, Intensity, Intensity]
    """Of the material: RGB."""
    lower: Vector3
    """Corners of the box in which positions of grains are resolved [m]."""
    upper: Vector3
    bodies: Annotated[list[BodyEntry], Field(max_length=10_000)]
    tool: Name = ""
    """Body whose path is drawn and at which grains act; empty: none."""
    hand: Name = ""
    """Body that holds it; empty: none."""
    curves: Annotated[list[CurveEntry], Field(max_length=1000)] = []  # noqa: RUF012
    regions: Annotated[list[RegionEntry], Field(max_length=MAX_ENTRIES)] = []  # noqa: RUF012
    waypoints: Annotated[list[WaypointEntry], Field(max_length=MAX_ENTRIES)] = []  # noqa: RUF012
    cameras: Annotated[list[CameraEntry], Field(max_length=MAX_ENTRIES)] = []  # noqa: RUF012

    @property
    def moving(self) -> list[BodyEntry]:
        """The bodies whose poses frames have, in their order."""
        return [body for body in self.bodies if body.moves]


def floats(values: ArrayLike) -> Any:
    """Return a vector (n,) as a tuple of numbers of Python."""
    return tuple(map(float, np.asarray(values)))


def region_entry(name: str, region: mpm.Region, pose: mpm.Pose | None = None, body: str = "",
                 is_place: bool = True, is_marked: bool = False) -> RegionEntry:
    """Make the entry of a region of the field; pose: of its frame in the world, or in that of its body."""
    centre = region.centre if pose is None else pose.apply(np.array([region.centre]))[0]
    return RegionEntry(name=name, body=body, position=floats(centre), round=region.round,
                       half=floats(np.minimum(region.half, LARGEST_HALF)), is_place=is_place, is_marked=is_marked,
                       quaternion=(1.0, 0.0, 0.0, 0.0) if pose is None else floats(pose.quaternion))


def region_pose(region: RegionEntry, bodies: Mapping[str, mpm.Pose]) -> mpm.Pose:
    """Return the world pose of a region's frame; bodies: name -> world pose."""
    own = mpm.Pose(np.array(region.position), np.array(region.quaternion))
    return bodies[region.body] @ own if region.body in bodies else own


def body_poses(header: RecordingHeader, poses: np.ndarray) -> dict[str, mpm.Pose]:
    """Return the world poses of the moving bodies by name; poses: (bodies, 7) of a frame."""
    return {body.name: mpm.Pose(row[:3], row[3:]) for body, row in zip(header.moving, poses)}


def find_placed(regions: Sequence[RegionEntry], bodies: Mapping[str, mpm.Pose], positions: np.ndarray) -> np.ndarray:
    """Return which grains at positions (n, 3) [m] lie in one of the regions that are places (n,)."""
    left = np.arange(len(positions))
    """Grains that are in none of the regions so far: most lie in the first."""
    for region in regions:
        if region.is_place:
            box = mpm.Region((0.0, 0.0, 0.0), region.half, region.round)
            left = left[~box.holds(region_pose(region, bodies).inverse().apply(positions[left]))]
    placed = np.ones(len(positions), bool)
    placed[left] = False
    return placed
