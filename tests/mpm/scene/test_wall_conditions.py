"""Wall conditions of one's own: the protocol's example, a copy of a bundled one, momentum, derivatives, refusals."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from docstring_example import run_example
from field_parts import block, same, sand, unbalanced

import mpm
from mpm.backend import ti
from mpm.rollout.losses import WeightedDistance
from mpm.scene.wall_condition import WALL_PARAMETERS, Friction, Slip, Stick, WallCondition


@dataclass(frozen=True)
class Glue:
    """A copy of "stick", which shares nothing with it."""

    separable = False
    parameters = ()

    @staticmethod
    @ti.func
    def mirror(t, mass, p):
        return -t

    @staticmethod
    @ti.func
    def slide(t, n, mass, push, dt, p):
        return 0.0 * t

    @staticmethod
    @ti.func
    def slide_back(t, n, mass, push, dt, p, bar):
        return 0.0 * bar, 0.0 * mass, 0.0 * push


@dataclass(frozen=True, kw_only=True)
class Plate(Stick):
    """Material sticks to a wall that moves along x."""

    speed: float

    @property
    def parameters(self):
        return (self.speed,)

    @staticmethod
    @ti.func
    def mirror(t, mass, p):
        return 2.0 * mass * ti.Vector([p[0], 0.0, 0.0, 0.0]) - t

    @staticmethod
    @ti.func
    def slide(t, n, mass, push, dt, p):
        return ti.Vector([p[0], 0.0, 0.0, 0.0])

    slide_back = staticmethod(Glue.slide_back)


@dataclass(frozen=True, kw_only=True)
class Drag(Slip):
    """A wall with viscous drag: the tangential velocity decays at a rate [1/s]; without an adjoint of its own."""

    rate: float

    @property
    def parameters(self):
        return (self.rate,)

    @staticmethod
    @ti.func
    def slide(t, n, mass, push, dt, p):
        return t * ti.exp(-p[0] * dt)


def corner(walls: mpm.Walls) -> mpm.Solver:
    """Sand thrown into a corner of three walls."""
    thrown = block(sand(nu=0.3), (0, 0, 0), (0.1, 0.14, 0.1), 0.01, (-1.0, 0.5, -0.5), np.random.default_rng(1))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.2, 0.2, 0.2), 0.02), bodies=[thrown], walls=walls, precision="f64")


def channel(top: WallCondition) -> mpm.Solver:
    """A viscous fluid between a floor at rest and a wall above it, 4 cm apart."""
    height, cell = 0.04, 0.005
    fluid = mpm.NewtonianFluid(bulk_modulus=2e4, density=1000.0, viscosity=5.0)
    walls = mpm.Walls(lower=("periodic", "periodic", "stick"), upper=("periodic", "periodic", top))
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.02, cell, height), cell), walls=walls, gravity=(0, 0, 0),
                      bodies=[block(fluid, (0, 0, 0), (0.02, cell, height), cell / 2)])


@pytest.mark.long
def test_a_copy_of_stick_is_stick_to_the_bit() -> None:
    ends = []
    for condition in ("stick", Glue()):
        solver = corner(mpm.Walls.all(condition))
        solver.advance(0.02)
        ends.append(solver.state() | {"ledger": solver.ledger})
    assert same(*ends)


def test_a_scene_compiles_the_conditions_of_its_walls() -> None:
    """One of each class; numbers are those of each side."""
    walls = mpm.Walls(lower=("periodic", "stick", Plate(speed=1.0)), upper=("periodic", "stick", Plate(speed=2.0)))
    fields = corner(walls).fields
    assert [type(condition) for condition in fields.wall_conditions] == [Stick, Plate]
    assert fields.parameters.wall_numbers.to_numpy()[:, 0] == pytest.approx([0, 0, 0, 0, 1, 2])
    enclosed = corner(mpm.Walls.all("periodic"))
    assert "fold walls" not in [phase.name for phase in enclosed.loop.stepper.phases]


def test_momentum_closes_against_conditions_of_ones_own() -> None:
    """What the grains gain is gravity and wall impulses and nothing else, linear and angular; a plate with a
    speed along its normal stays where it is, and other walls stand beside it."""
    solver = corner(mpm.Walls(lower=(Plate(speed=-0.7), Drag(rate=20.0), Plate(speed=0.7)),
                              upper=("friction", "stick", "roller")))
    assert len(solver.fields.wall_conditions) == 5 and max(unbalanced(solver, 20, 10 * solver.dt, 2)) <= 1e-12
    assert solver.diagnostics().escaped == 0 and solver.positions().min() > -1e-3


def test_the_example_of_a_condition_is_a_belt() -> None:
    """While an elastic block slides on it, it pulls by friction times its support; then the block has its speed."""
    names = {"dataclass": dataclass, "Friction": Friction, "ti": ti}
    Belt = run_example(WallCondition, "A belt takes ten lines:", names)["Belt"]
    friction, speed = 0.3, 0.2
    body = block(mpm.Elastic(E=1e5, nu=0.2, density=1000.0), (0.05, 0.05, 0), (0.11, 0.11, 0.03), 0.005)
    belt = Belt(coefficient=friction, velocity=(speed, 0.0, 0.0))
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.24, 0.16, 0.1), 0.01), bodies=[body],
                        walls=mpm.Walls(lower=("slip", "slip", belt), upper=("slip", "slip", "slip")))
    solver.advance(0.04)
    assert solver.ledger[1, 2] > 0 and solver.ledger[1, 0] == pytest.approx(friction * solver.ledger[1, 2], rel=0.01)
    solver.advance(0.1)
    assert solver.momentum().linear[0] / solver.masses().sum() == pytest.approx(speed, rel=0.02)


def test_flow_between_plates_is_linear() -> None:
    """Couette flow: between a floor at rest and a wall that moves, v = speed z / height, at the walls too."""
    speed = 0.3
    solver = channel(Plate(speed=speed))
    solver.advance(0.5)
    assert solver.velocities()[:, 0] == pytest.approx(speed * solver.positions()[:, 2] / 0.04, abs=1e-4 * speed)


@pytest.mark.slow
def test_the_derivative_through_a_moving_wall_is_that_of_differences() -> None:
    """By a fluid's viscosity, where the plate's speed enters fold, mirror and wall; the wall's mass in every one."""
    def scene(viscosity: float) -> mpm.Rollout:
        fluid = mpm.NewtonianFluid(bulk_modulus=2e4, density=1000.0, viscosity=viscosity)
        solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.1, 0.08, 0.08), 0.01), precision="f64", dt=5e-4,
                            walls=mpm.Walls(lower=(Glue(), "slip", Plate(speed=0.3)), upper=("slip", "slip", "slip")),
                            bodies=[block(fluid, (0.02, 0.02, 0.0), (0.06, 0.06, 0.03), 0.005,
                                          rng=np.random.default_rng(0))])
        return mpm.Rollout(solver, 20, step_dt=1e-3, materials=True)

    loss = WeightedDistance(np.array([0.1, 0.04, 0.0]), np.ones(3))
    roll = scene(5.0)
    roll.value_and_grad(None, None, loss)
    step = 1e-4
    high, low = (scene(5.0 + sign * step).value(None, None, loss) for sign in (1, -1))
    assert roll.last.materials[0]["viscosity"] == pytest.approx((high - low) / (2 * step), rel=1e-4)


@pytest.mark.parametrize(("condition", "message"), [
    (Drag(rate=1.0), "Drag has a slide of its own, but the slide_back of Slip"),
    (type("Bare", (), {name: vars(Glue)[name] for name in ("separable", "parameters", "mirror", "slide")})(),
     "Bare has no slide_back")])
def test_a_rollout_refuses_a_condition_without_adjoint_by_name(condition: WallCondition, message: str) -> None:
    solver = corner(mpm.Walls(lower=("slip", "slip", condition)))
    with pytest.raises(mpm.InvalidValue, match=message):
        mpm.Rollout(solver, 1)


@pytest.mark.parametrize(("change", "message"), [
    ({"slide": None}, "upper z: .* has no slide"), ({"parameters": None, "mirror": None}, "no parameters, mirror"),
    ({"slide": abs}, r"slide is not a static Taichi function"), ({"separable": 1}, "separable = 1; accepted: True"),
    ({"parameters": (1.0,) * (WALL_PARAMETERS + 1)}, "at most 4 finite numbers"),
    ({"parameters": (np.nan,)}, "at most 4 finite numbers")])
def test_an_incomplete_condition_is_refused_by_name(change: dict, message: str) -> None:
    members = {"separable": True, "parameters": (), **{name: vars(Glue)[name] for name in ("mirror", "slide")}} | change
    condition = SimpleNamespace(**{name: value for name, value in members.items() if value is not None})
    with pytest.raises(mpm.InvalidValue, match=message):
        mpm.Walls(upper=("slip", "slip", condition))


def test_what_is_no_condition_is_refused_by_name() -> None:
    with pytest.raises(mpm.InvalidValue, match=r"lower x: Glue \(a class\) is not an instance"):
        mpm.Walls(lower=(Glue, "slip", "slip"))
    with pytest.raises(mpm.UnknownName, match="'glue'; valid: friction, periodic, roller, slip, stick"):
        mpm.Walls.all("glue")
    with pytest.raises(mpm.InvalidValue, match="lower has 2 conditions; accepted: 3"):
        mpm.Walls(lower=("slip", "slip"))
    with pytest.raises(mpm.InvalidValue, match="Friction: coefficient = -1"):
        Friction(coefficient=-1.0)
