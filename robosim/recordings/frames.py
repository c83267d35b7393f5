"""Frames of a recording, poses with readings and quantised grains, as bytes and back."""

import itertools
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

KEY_INTERVAL = 25
"""Frames from one with whole positions to the next; those between have differences from the one before."""
STEPS = 65535
"""Steps that an edge of the grains' box is resolved in: 13 micrometres of 0.86 m."""
SPEEDS = (1e-3, 10.0)
"""Range of the recorded speeds of grains [m/s], in 254 steps of 3.7 %; zero below."""
PRESSURES = (1.0, 1e6)
"""Range of their pressures [Pa], in 254 steps of 5.6 %."""
SCENE = struct.Struct("<dqq")
"""Before the poses and readings of a frame: its time [s], the numbers of moving bodies and of curves."""
POSITIONS = struct.Struct("<q?")
"""Before the grains of a frame: their number, and whether positions are whole."""


class GrainState(NamedTuple):
    """What a frame knows of the grains."""

    positions: np.ndarray
    """(n, 3) [m]"""
    speeds: np.ndarray
    """(n,) [m/s]"""
    pressures: np.ndarray
    """(n,) [Pa]; zero where grains pull or are free."""
    awake: np.ndarray
    """(n,) bool"""


class SceneState(NamedTuple):
    """What a frame has besides the grains."""

    time: float
    """[s]"""
    poses: np.ndarray
    """(bodies, 7) of the moving bodies: position [m], quaternion (w, x, y, z)."""
    wrench: np.ndarray
    """(6,) of the grains on the tool: force [N], torque [N m], world axes."""
    values: np.ndarray
    """(curves,) in the units of the header; NaN where there is none."""


def pack_scene(scene: SceneState) -> bytes:
    """Return poses and readings as bytes."""
    return SCENE.pack(scene.time, len(scene.poses), len(scene.values)) + b"".join(
        np.asarray(part, "<f4").tobytes() for part in (scene.poses, scene.wrench, scene.values))


def unpack_scene(content: bytes) -> SceneState:
    """Return the poses and readings of bytes; raises ValueError where they are none."""
    if len(content) < SCENE.size:
        raise ValueError("a frame ends early")
    time, bodies, curves = SCENE.unpack_from(content)
    poses, wrench, values = cut(content, SCENE.size, [28 * bodies, 24, 4 * curves])
    return SceneState(time, np.frombuffer(poses, "<f4").reshape(bodies, 7).astype(float),
                    np.frombuffer(wrench, "<f4").astype(float), np.frombuffer(values, "<f4").astype(float))


class GrainCodec:
    """Packs the grains of the frames of one scene in order, or unpacks them.
    lower, upper: corners of the box in which positions are resolved [m] (3,)."""

    def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None:
        self._lower = np.asarray(lower, float)
        self._step = (np.asarray(upper, float) - self._lower) / STEPS
        self._last: np.ndarray | None = None
        """Quantised positions (3, n) of the frame before."""

    def pack(self, grains: GrainState, is_key: bool) -> bytes:
        """Return grains as bytes; is_key: with whole positions, readable without the frames before them."""
        scaled = np.rint((np.asarray(grains.positions).T - self._lower[:, None]) / self._step[:, None])
        steps = np.clip(np.nan_to_num(scaled), 0, STEPS).astype(np.uint16)
        is_whole = is_key or self._last is None
        stored = steps if is_whole else steps - self._last  # modulo 2**16
        self._last = steps
        planes = np.stack([stored & 0xFF, stored >> 8]).astype(np.uint8)  # high bytes are nearly all zero
        return b"".join([POSITIONS.pack(steps.shape[1], is_whole), planes.tobytes(),
                         to_levels(grains.speeds, *SPEEDS).tobytes(), to_levels(grains.pressures, *PRESSURES).tobytes(),
                         np.packbits(grains.awake).tobytes()])

    def unpack(self, content: bytes) -> GrainState:
        """Return the grains of bytes; raises ValueError where they are none, or need those of a frame before."""
        if len(content) < POSITIONS.size:
            raise ValueError("grains end early")
        n, is_whole = POSITIONS.unpack_from(content)
        planes, speeds, pressures, awake = cut(content, POSITIONS.size, [6 * n, n, n, (n + 7) // 8])
        low, high = np.frombuffer(planes, np.uint8).reshape(2, 3, n).astype(np.uint16)
        stored = low | high << 8
        if not is_whole:
            if self._last is None or self._last.shape != stored.shape:
                raise ValueError("grains are differences from a frame that is missing")
            stored = stored + self._last
        self._last = stored
        return GrainState((self._lower + stored.T * self._step).astype(np.float32),
                          from_levels(np.frombuffer(speeds, np.uint8), *SPEEDS),
                          from_levels(np.frombuffer(pressures, np.uint8), *PRESSURES),
                          np.unpackbits(np.frombuffer(awake, np.uint8), count=n).astype(bool))


def cut(content: bytes, begin: int, sizes: list[int]) -> list[bytes]:
    """Cut bytes from a place on into parts; raises ValueError where their sizes do not add up to the end."""
    if min(sizes) < 0 or begin + sum(sizes) != len(content):
        raise ValueError(f"a block has {len(content)} bytes; its numbers say {begin + sum(sizes)}")
    places = np.cumsum([begin, *sizes])
    return [content[a:b] for a, b in itertools.pairwise(places)]


def to_levels(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return values (n,) as levels 1 to 255 on a logarithmic scale from low to high; 0 below low, or not finite."""
    values = np.nan_to_num(np.asarray(values, float), posinf=high)
    levels = 1.0 + np.rint(254.0 * np.log(np.clip(values, low, high) / low) / np.log(high / low))
    return np.where(values < low, 0, levels).astype(np.uint8)


def from_levels(levels: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the values (n,) of levels."""
    values = low * (high / low) ** ((levels.astype(np.float32) - 1.0) / 254.0)
    return np.where(levels == 0, 0.0, values).astype(np.float32)
