"""The protocol of a material law: what a law must offer to the field."""

import math
from inspect import signature
from typing import Any, Protocol

from mpm.errors import InvalidValue

PARAMETERS = 8  # the most numbers that a law may hand to the kernels
MAPPED = ("h", "vc", "p", "dt")  # what a return mapping is given
STATES = ("hencky", "cauchy_green", "volume")  # what a particle may remember, see `Material.state`


class Material(Protocol):
    """A material law: a frozen dataclass of numbers, and Taichi functions that kernels call.

    The functions are static, element-wise and free of branches (min, max, select), so that the same code runs on packs
    of particles and on scalars, in single and in double precision. Symmetric tensors are lists of six entries
    [xx, yy, zz, xy, xz, yz]; `p` holds the numbers of `parameters` in their order. What is computed once and used more
    than once goes through `once`. A law whose stress is cubic in the logarithmic strain takes ten lines:

        @dataclass(frozen=True, kw_only=True)
        class Stiffening(Hencky):
            factor: float

            @property
            def parameters(self):
                return (self.mu, self.lam, self.factor)

            @staticmethod
            @ti.func
            def stress(h: ti.template(), p: ti.template()):
                square = h[0] * h[0] + h[1] * h[1] + h[2] * h[2] + 2.0 * (h[3] * h[3] + h[4] * h[4] + h[5] * h[5])
                mu = p[0] * (1.0 + p[2] * square)
                return [once(2.0 * mu * h[i] + (p[1] * (h[0] + h[1] + h[2]) if ti.static(i < 3) else 0.0))
                        for i in range(6)]

    Besides the members below a law has `stress`, and where `plastic` is True `return_mapping`:

    stress(state, p) -> Kirchhoff stress [Pa], six entries. With the state "volume" it is stress(j, C, p), with C the
        velocity gradient [1/s], nine entries row by row.
    return_mapping(h, vc, p, dt) -> (h, vc) after the plastic flow of dt [s], from those of the elastic trial state; vc
        is the logarithmic expansion that the law remembers, 0 for a law without volume correction.
    soften(p, firm) -> the numbers of particles with a share of the stiffness, where the material around them is less
        dense: with all elastic moduli times `firm`, and the same stress where it yields. Not with the state "volume";
        a law without it is as stiff everywhere, and takes a smaller time step.
    viscosity -> largest dynamic viscosity [Pa s] of a stress that depends on C: it bounds the time step. A law without
        it has none.
    energy_density(stretches) -> elastic energy [J/m^3] (n,) at principal stretches (n, 3), for NumPy arrays; not
        for the state "volume".
    stress_back(state, p, tau_bar) -> (state_bar, p_bar), return_mapping_back(h, vc, p, dt, h_bar, vc_bar, soft)
        -> (h_bar, vc_bar, p_bar), and soften_back(p, firm, p_bar) -> (p_bar, firm_bar): the adjoints, which only
        differentiable rollouts need."""

    @property
    def density(self) -> float:
        """Bulk density [kg/m^3]."""
        ...

    @property
    def state(self) -> str:
        """What a particle remembers and `stress` is given.
        "hencky": h = log(b) / 2, kept as e = b - I; "cauchy_green": e = b - I, with b the elastic left Cauchy-Green
        tensor; "volume": j = J - 1, with J the volume ratio."""
        ...

    @property
    def plastic(self) -> bool:
        """Whether the law has a `return_mapping`; only with the state "hencky"."""
        ...

    @property
    def has_volume_correction(self) -> bool:
        """Whether particles remember an expansion that is recovered before stress returns."""
        ...

    @property
    def mu(self) -> float:
        """Shear modulus [Pa] of the stable time step."""
        ...

    @property
    def lam(self) -> float:
        """Lame's first parameter [Pa] of the stable time step."""
        ...

    @property
    def parameters(self) -> tuple[float, ...]:
        """Numbers that the kernels read, at most `PARAMETERS`."""
        ...


def stiffens_with_density(law: Material) -> bool:
    """Return whether a law is softer where the material is looser than a packing, see `firmness`."""
    return hasattr(law, "soften")


def check_material(law: Any) -> None:
    """Raise InvalidValue for an object that lacks what `Material` asks for."""
    name = type(law).__name__
    if isinstance(law, type):
        raise InvalidValue(f"Body: material = {law.__name__} (a class); accepted: a law, {law.__name__}(...)")
    needed = ["density", "state", "plastic", "has_volume_correction", "mu", "lam", "parameters", "stress"]
    needed += ["return_mapping"] if getattr(law, "plastic", False) else []
    needed += ["energy_density"] if getattr(law, "state", "") != "volume" else []
    missing = [member for member in needed if not hasattr(law, member)]
    if missing:
        raise InvalidValue(f"Body: material {name} has no {', '.join(missing)}; accepted: a law as mpm.materials."
                           f"material.Material describes it")
    if law.plastic and len(signature(law.return_mapping).parameters) != len(MAPPED):
        raise InvalidValue(f"Body: material {name} has return_mapping{signature(law.return_mapping)}; accepted: "
                           f"return_mapping({', '.join(MAPPED)})")
    if law.state not in STATES or (law.plastic and law.state != "hencky"):
        raise InvalidValue(f"Body: material {name} has the state {law.state!r}, plastic = {law.plastic}; accepted: "
                           f"{', '.join(STATES)}, and \"hencky\" for a plastic law")
    if law.state == "volume" and stiffens_with_density(law):
        raise InvalidValue(f"Body: material {name} has the state 'volume' and `soften`; accepted: one of them")
    if len(law.parameters) > PARAMETERS:
        raise InvalidValue(f"Body: material {name} has {len(law.parameters)} parameters; accepted: {PARAMETERS} or "
                           f"fewer")


def check_range(owner: str, name: str, value: float, low: float, high: float) -> None:
    """Raise InvalidValue unless low <= value < high."""
    if not (low <= value < high):
        bound = "" if math.isinf(high) else f" and below {high:g}"
        raise InvalidValue(f"{owner}: {name} = {value:g}; accepted: at least {low:g}{bound}")
