"""What a scene has. Kernels read these inside `ti.static` only: what is absent is not compiled."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Features:
    """Derived from the scene when the solver is built."""

    precision: str
    """"f32" or "f64"."""
    integrator: str
    """"series" or "exact": how strain is taken from and put back into b."""
    volume_correction: bool
    """Some material remembers expansion."""
    tensor_state: bool
    """Some material remembers b."""
    volume_state: bool
    """Some material remembers J."""
    moving_colliders: tuple[int, ...]
    """Colliders that are given a motion."""
    static_colliders: tuple[int, ...]
    """Colliders that never move: their contact is looked up once per node."""
