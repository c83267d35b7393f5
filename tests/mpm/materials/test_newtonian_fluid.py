"""The volume of a fluid: positive at any rate, the same after a cycle; and fluids that do not pull."""

import numpy as np
import pytest
from field_parts import block, same

import mpm
from mpm.backend import default_precision, ti
from mpm.materials.stable_step import choose_step
from mpm.materials.stress_update import LEAST_RATIO, advance_volume

CELL, BULK = 0.02, 1e5
GRID = mpm.Grid((0, 0, 0), (0.4, 0.4, 0.4), CELL)
REAL = {"f32": np.float32, "f64": np.float64}


def after(j: np.ndarray, d: np.ndarray, precision: str, steps: int = 1) -> np.ndarray:
    """J - 1 (n,) after `steps` substeps with d = dt tr(C) (n,), in a precision."""

    @ti.kernel
    def advance(j: ti.types.ndarray(), d: ti.types.ndarray(), steps: ti.i32):
        for i in range(j.shape[0]):
            for _ in range(steps):
                j[i] = advance_volume(j[i], d[i])

    result = np.array(j, REAL[precision])
    with default_precision(precision):
        advance(result, np.asarray(d, REAL[precision]), steps)
    return result


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_the_volume_is_positive_at_any_rate(precision: str) -> None:
    """Also where the rate is many times what a substep can follow, and again and again; and it comes back."""
    d = np.concatenate([-np.logspace(-6, 6, 49), np.logspace(-6, 6, 49)])
    for ratio in (1.0, 0.3, 1e-3, LEAST_RATIO):
        found = after(np.full(len(d), ratio - 1.0), d, precision)
        assert np.isfinite(found).all()
        assert (1.0 + found >= LEAST_RATIO).all()
    pressed = after(np.zeros(4), np.array([-0.3, -2.0, -10.0, -1e3]), precision, 200)
    assert (1.0 + pressed == LEAST_RATIO).all()
    assert (after(pressed, np.full(4, 0.1), precision) > pressed).all()


def test_a_small_rate_changes_the_volume_by_its_exponential() -> None:
    """J = exp(d), but for d^3 / 6."""
    d = np.linspace(-0.05, 0.05, 21)
    found = after(np.zeros(len(d)), d, "f64")
    assert found == pytest.approx(np.expm1(d - d**3 / 6), abs=1e-7) and np.abs(found - np.expm1(d)).max() <= 0.05**3 / 5
    single = after(np.zeros(1), np.full(1, 1e-6), "f32")
    assert single == pytest.approx(1e-6, rel=1e-5)


@pytest.mark.parametrize(("precision", "bound"), [("f32", 2e-5), ("f64", 1e-13)])
def test_a_cycle_leads_back(precision: str, bound: float) -> None:
    """Compressed and expanded by the same substeps, J is what it was; 1 + d in each would leave a loss of d^2."""
    for d, steps in ((1e-2, 100), (0.2, 10), (3.0, 1)):
        for sign in (-1.0, 1.0):
            there = after(np.zeros(1), np.full(1, sign * d), precision, steps)
            assert abs(np.log1p(there.astype(float))[0]) == pytest.approx(steps * np.arcsinh(d), rel=1e-3)
            back = after(there, np.full(1, -sign * d), precision, steps)
            assert abs(float(back[0])) <= bound


def strained(tension: bool, strain: float) -> mpm.Solver:
    """A block of fluid at rest in the middle of a room without gravity, with J - 1 = strain."""
    fluid = mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0, viscosity=1.0, tension=tension)
    solver = mpm.Solver(grid=GRID, gravity=(0, 0, 0), bodies=[block(fluid, (0.16,) * 3, (0.24,) * 3, CELL / 2)])
    state = solver.state()
    state["j"][:] = strain
    solver.load(state)
    return solver


def test_a_stretched_block_does_not_pull() -> None:
    """Without tension it stays at rest, without stress or energy; with it, it contracts."""
    for tension in (False, True):
        with strained(tension, 0.05) as solver:
            assert np.abs(solver.stresses()).max() == pytest.approx(BULK * 0.05 * tension, rel=1e-5)
            elastic = 0.5 * BULK * 0.05**2 * 0.08**3
            assert solver.energy().elastic == pytest.approx(elastic * tension, rel=1e-5)
            solver.advance(5 * solver.dt)
            assert (np.abs(solver.velocities()).max() > 0.01) == tension
            assert solver.velocities().any() == tension


def test_without_tension_pressure_is_the_same() -> None:
    """A compressed block begins to expand to the bit as with tension."""
    ends = []
    for tension in (False, True):
        with strained(tension, -0.05) as solver:
            solver.advance(solver.dt)
            ends.append(solver.state())
    assert np.abs(ends[0]["v"]).max() > 0.01 and same(*ends)


def test_what_flies_apart_keeps_its_speed() -> None:
    """Every particle of a block that expands evenly flies freely where the fluid does not pull."""
    kept = {}
    for tension in (False, True):
        with strained(tension, 0.0) as solver:
            state = solver.state()
            state["v"][:] = 20.0 * (solver.positions() - 0.2)
            state["C"][:, [0, 4, 8]] = 20.0
            solver.load(state)
            before = solver.energy().kinetic
            solver.advance(0.01)
            kept[tension] = solver.energy().kinetic / before
            assert (solver.state()["j"] > 0.3).all() == (not tension)
    assert kept[False] == pytest.approx(1.0, abs=0.03) and kept[True] < 0.9


def test_what_is_no_tension_is_refused() -> None:
    with pytest.raises(mpm.InvalidValue, match=r"NewtonianFluid: tension = 'no'; accepted: True or False"):
        mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0, tension="no")
    fluid = mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0, tension=False)
    place = np.full((1, 3), 0.2)
    with pytest.raises(mpm.InvalidValue, match=r"tension=False\) has a tension of 1e\+03 Pa; accepted: -pressure"):
        mpm.Body(fluid, place, volume=1e-6, stress=1e3 * np.eye(3)[None])
    mpm.Body(fluid, place, volume=1e-6, stress=-1e3 * np.eye(3)[None])


def rated(volume_rate: str, positions: np.ndarray, **options) -> mpm.Solver:
    """Fluid at positions [m] (n, 3) in a room without gravity, whose volume follows a rate."""
    fluid = mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0, volume_rate=volume_rate)
    return mpm.Solver(grid=GRID, gravity=(0, 0, 0), precision="f64",
                      bodies=[mpm.Body(fluid, positions, volume=(CELL / 2) ** 3)], **options)


def test_a_cell_has_one_rate_of_volume() -> None:
    """The mean of its particles' own rates, weighted by volume: the volume of all fluid changes as without."""
    positions = mpm.sample_box((0.16, 0.16, 0.16), (0.24, 0.24, 0.24), CELL / 2, np.random.default_rng(0))[:-3]
    rates = np.random.default_rng(1).uniform(-1.0, 1.0, (len(positions), 9))
    ends = {}
    for volume_rate in ("particle", "cell"):
        with rated(volume_rate, positions) as solver:
            state = solver.state()
            state["C"][:] = rates
            solver.load(state)
            solver.advance(solver.dt)
            ends[volume_rate] = np.sinh(np.log1p(solver.state()["j"][:, 0])) / solver.dt
    trace = rates[:, [0, 4, 8]].sum(1)
    assert ends["particle"] == pytest.approx(trace, abs=1e-9)
    cells = np.unique(np.floor(positions / CELL).astype(int), axis=0, return_inverse=True)[1].ravel()
    mean = np.bincount(cells, trace) / np.bincount(cells)
    assert ends["cell"] == pytest.approx(mean[cells], abs=1e-9)
    assert ends["cell"].sum() == pytest.approx(ends["particle"].sum(), abs=1e-8)


@pytest.mark.long
def test_a_fluid_with_the_rate_of_its_cell_shears_freely() -> None:
    """A steady flow without compression loses to transfers alone; by its particles' rates it is resisted besides.
    What transfers take is what a fluid loses that resists no compression. The rate of the cell leaves less than half of
    the resistance: the flow has no compression on average over a cell."""
    positions = mpm.sample_box((0, 0, 0), (0.4, 0.08, 0.4), CELL / 2)
    dt = choose_step(None, CELL, [mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0)])
    kept = {}
    for label, bulk_modulus in (("free", 1e-6 * BULK), ("particle", BULK), ("cell", BULK)):
        fluid = mpm.NewtonianFluid(bulk_modulus=bulk_modulus, density=1000.0,
                                   volume_rate="cell" if label == "cell" else "particle")
        x, _, z = np.pi / 0.1 * positions.T  # four vortices a side, five cells each
        velocities = 0.01 * np.stack([np.sin(x) * np.cos(z), 0 * x, -np.cos(x) * np.sin(z)], 1)
        with mpm.Solver(grid=mpm.Grid((0, 0, 0), (0.4, 0.08, 0.4), CELL), gravity=(0, 0, 0), precision="f64",
                        walls=mpm.Walls.all("roller"), transfer_interval=0.02, dt=dt,
                        bodies=[mpm.Body(fluid, positions, velocities, volume=(CELL / 2) ** 3)]) as solver:
            before = solver.energy().kinetic
            for _ in range(5):
                solver.advance(0.02)
            kept[label] = solver.energy().kinetic / before
    assert kept["particle"] < kept["free"] <= 1.0, kept
    assert kept["free"] - kept["cell"] < 0.5 * (kept["free"] - kept["particle"]), kept


def test_rates_of_volume_that_cannot_be_are_refused() -> None:
    """A word, two rates in a scene, sleeping, and a change in a scene that stands."""
    with pytest.raises(mpm.UnknownName, match=r"volume_rate 'grid'.*particle"):
        mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0, volume_rate="grid")
    place = np.full((1, 3), 0.2)
    own, mean = (mpm.NewtonianFluid(bulk_modulus=BULK, density=1000.0, volume_rate=r) for r in ("particle", "cell"))
    with pytest.raises(mpm.InvalidValue, match=r"bodies\[1\] is a fluid with volume_rate = 'cell', and bodies\[0\]"):
        mpm.Solver(grid=GRID, bodies=[mpm.Body(own, place, volume=1e-6), mpm.Body(mean, place - 0.1, volume=1e-6)])
    with pytest.raises(mpm.InvalidValue, match=r"sleep, and bodies\[0\] is a fluid with volume_rate = 'cell'"):
        mpm.Solver(grid=GRID, bodies=[mpm.Body(mean, place, volume=1e-6)], sleep=True)
    solver = mpm.Solver(grid=GRID, bodies=[mpm.Body(mean, place, volume=1e-6)])
    with pytest.raises(mpm.InvalidValue, match=r"set_material: volume_rate = 'particle'; accepted: 'cell'"):
        solver.set_material(0, own)
    with pytest.raises(mpm.InvalidValue, match=r'Rollout: the scene has a fluid with volume_rate="cell", which is not'):
        mpm.Rollout(solver, n_steps=1, step_dt=1e-3)
