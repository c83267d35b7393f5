"""A picture of a run's scene: a section through its grains, its colliders and the room."""

import base64
import io
import itertools

import numpy as np
import trimesh
from PIL import Image, ImageDraw

import mpm
from mpm.geometry.shape import Shape

LONGEST, FINER = 320, 3
"""Longer side of the picture [pixels]; lines and grains are drawn so many times as fine."""
BACK, SOLID, EDGE = (255, 255, 255), (122, 130, 142), (70, 78, 90)
BODIES = ((201, 150, 74), (47, 111, 168), (75, 143, 78))
"""Colours of the bodies, in turn."""
GRAIN = 0.4
"""Radius of a grain's disc, in edges of the cube that has its volume."""
MARGIN = 2.0
"""Cells that the picture shows around grains and colliders, as far as the grid goes."""


def draw_section(solver: mpm.Solver) -> str:
    """Return a PNG, in base64, of a section through a solver's scene as it is now, upright where there is a choice.
    The plane goes through the first collider, where grains are there, else through where most grains are; it shows the
    grains within half a cell of it."""
    across, place = choose_plane(solver)
    right, up = (axis for axis in range(3) if axis != across)
    lower, upper = find_frame(solver, across, place)
    scale = LONGEST * FINER / max(upper[right] - lower[right], upper[up] - lower[up])
    width, height = (max(int(scale * (upper[axis] - lower[axis])), FINER) for axis in (right, up))
    points = np.full((height, width, 3), place)
    points[..., right] = lower[right] + (np.arange(width) + 0.5) / scale
    points[..., up] = upper[up] - (np.arange(height)[:, None] + 0.5) / scale
    colours = np.full((height, width, 3), BACK, np.uint8)
    for index, collider in enumerate(solver.colliders):
        if not collider.sdf.is_thin:
            colours[is_inside(collider.sdf, solver.collider_pose(index), points)] = SOLID
    picture = Image.fromarray(colours)
    draw = ImageDraw.Draw(picture)

    def place_of(point: np.ndarray) -> tuple[float, float]:
        return scale * (point[right] - lower[right]), scale * (upper[up] - point[up])

    x, volumes = solver.positions(), solver.masses() / solver.densities()
    near = np.abs(x[:, across] - place) < 0.5 * solver.grid.cell
    for colour, (_, rows) in zip(itertools.cycle(BODIES), solver.ranges()):
        r = GRAIN * scale * np.cbrt(np.mean(volumes[rows]))
        for point in x[rows][near[rows]]:
            u, v = place_of(point)
            draw.ellipse((u - r, v - r, u + r, v + r), fill=colour)
    for index, collider in enumerate(solver.colliders):
        if isinstance(collider.sdf, mpm.Shell):
            pen = max(round(scale * collider.sdf.thickness), FINER)
            for segment in cut(collider.sdf.mesh, solver.collider_pose(index), across, place):
                draw.line([place_of(end) for end in segment], fill=SOLID, width=pen)
    draw.rectangle((0, 0, width - 1, height - 1), outline=EDGE, width=FINER)
    small = picture.resize((max(width // FINER, 1), max(height // FINER, 1)), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    small.quantize(palette=make_palette(), dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


def make_palette() -> Image.Image:
    """Return an image with the picture's colours, and what lies between them and the background, as its palette."""
    between = np.linspace(1.0, 0.0, 3, endpoint=False)[:, None, None]
    colours = between * np.array([SOLID, EDGE, *BODIES]) + (1.0 - between) * BACK
    palette = Image.new("P", (1, 1))
    palette.putpalette([*BACK, *colours.round().astype(int).ravel().tolist()])
    return palette


def choose_plane(solver: mpm.Solver) -> tuple[int, float]:
    """Return the axis across the section, the one with the fewest cells or y, and the plane's place [m] on it."""
    low, high = np.array(solver.grid.lower), np.array(solver.grid.upper)
    cells = np.round((high - low) / solver.grid.cell)
    across = 1 if cells[1] <= cells.min() else int(np.argmin(cells)) if cells.min() <= MARGIN else 1
    if cells[across] <= MARGIN:
        return across, float(low[across] + high[across]) / 2
    along = solver.positions()[:, across]
    for index in range(len(solver.colliders)):
        here = float(solver.collider_pose(index).position[across])
        if along.min() <= here <= along.max():
            return across, here
    counts, edges = np.histogram(along, bins=np.arange(low[across], high[across] + solver.grid.cell, solver.grid.cell))
    place = int(np.argmax(counts))
    return across, float(edges[place] + edges[place + 1]) / 2


def find_frame(solver: mpm.Solver, across: int, place: float) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper corner [m] (3,) of what there is to see, with a margin, inside the grid."""
    x, margin = solver.positions(), MARGIN * solver.grid.cell
    low, high = x.min(0), x.max(0)
    for index, collider in enumerate(solver.colliders):
        pose = solver.collider_pose(index)
        corners = np.stack(np.meshgrid(*zip(*collider.sdf.bounds), indexing="ij"), -1).reshape(-1, 3)
        placed = corners @ pose.matrix.T + pose.position
        if placed[:, across].min() <= place <= placed[:, across].max():
            low, high = np.minimum(low, placed.min(0)), np.maximum(high, placed.max(0))
    return np.maximum(low - margin, solver.grid.lower), np.minimum(high + margin, solver.grid.upper)


def is_inside(shape: Shape, pose: mpm.Pose, points: np.ndarray) -> np.ndarray:
    """Return which points [m] (..., 3) are inside a solid at a pose."""
    local = ((points - pose.position) @ pose.matrix).reshape(-1, 3)
    inside, near = np.zeros(len(local), bool), shape.near_inside(local)
    inside[near] = shape.distance(local[near]) < 0.0
    return inside.reshape(points.shape[:-1])


def cut(mesh: trimesh.Trimesh, pose: mpm.Pose, across: int, place: float) -> np.ndarray:
    """Return the segments [m] (n, 2, 3) in which a plane across an axis cuts a surface at a pose."""
    placed = trimesh.Trimesh(mesh.vertices @ pose.matrix.T + pose.position, mesh.faces, process=False)
    normal = np.eye(3)[across]
    return np.asarray(trimesh.intersections.mesh_plane(placed, normal, place * normal))
