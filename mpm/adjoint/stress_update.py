"""Adjoint of the constitutive update: from adjoints of stress and new state to those of old state and rate."""

from mpm.backend import once, real_type, ti
from mpm.materials.density import CHANGE, LEAST, density_to_take_up, firmness, share_of
from mpm.materials.hencky_strain import log1p
from mpm.materials.material import Material, stiffens_with_density
from mpm.materials.stress_update import LEAST_RATIO, advance_cauchy_green, advance_volume, volume_growth
from mpm.materials.symmetric_tensor import FULL, JACOBI_SWEEPS, compose, spectrum
from mpm.materials.tensor_adjoint import (
    bar_of_matrix,
    exponential_back,
    logarithm_back,
    matrix_of_bar,
    multiply,
    transpose,
)
from mpm.state.packs import LANES

SWEEPS = {"f32": 4, "f64": JACOBI_SWEEPS}
"""Jacobi sweeps to rounding: eigenvalues of 10 000 random tensors, coinciding ones among them, to 3e-7."""


class ForwardIntermediates:
    """Intermediate values of the constitutive update of every pack, which its adjoint needs.
    svd: divided differences as autodiff through a singular value decomposition forms them. soft: relative width over
    which derivatives take the yield surface for smooth."""

    def __init__(self, laws: tuple[Material, ...], n_packs: int, precision: str, *, svd: bool = False,
                 soft: float = 0.0) -> None:
        def packs(n: int, needed: bool) -> list:
            return [ti.Vector.field(LANES, real_type(precision), n_packs) for _ in range(n if needed else 0)]

        self.sweeps, self.svd, self.soft = SWEEPS[precision], svd, soft
        states = {law.state for law in laws}
        self.tau = packs(6, True)
        """Stress / Pa, and then its adjoint."""
        self.j = packs(1, "volume" in states)
        self.trial = packs(6, "cauchy_green" in states)
        self.d, self.v, self.h = (packs(n, "hencky" in states) for n in (3, 9, 6))
        """Eigenvalues and eigenvectors of the trial e, and the trial strain."""
        self.mapped = packs(6, any(law.plastic for law in laws))
        """Strain after the return mapping."""


@ti.func
def write_list(fields: ti.template(), q, values: ti.template()):
    """Store a list of packs in a list of fields."""
    for i in ti.static(range(len(fields))):
        fields[i][q] = values[i]


@ti.func
def read_list(fields: ti.template(), q):
    """Return a list of packs from a list of fields."""
    return [once(fields[i][q]) for i in range(len(fields))]


@ti.func
def recompute(P: ti.template(), T: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
    """Repeat the constitutive update of pack q from the state before the substep, which stays; store it in T.
    Where dt is 0 there is no update: the stress is that of the state."""
    if ti.static(law.state == "volume"):
        T.j[0][q] = advance_volume(P.j[q], dt * (C[0] + C[4] + C[8]))
        write_list(T.tau, q, law.stress(once(T.j[0][q]), C, p))
    else:
        trial = advance_cauchy_green([once(P.e[i][q]) for i in range(6)], [once(dt * C[i]) for i in range(9)])
        if ti.static(law.state == "cauchy_green"):
            write_list(T.trial, q, trial)
            write_list(T.tau, q, law.stress(trial, p))
        else:
            d, v = spectrum(trial, ti.static(T.sweeps))
            h = compose([once(0.5 * log1p(d[i])) for i in range(3)], v)
            write_list(T.d, q, d)
            write_list(T.v, q, v)
            write_list(T.h, q, h)
            if ti.static(law.plastic):
                write_list(T.mapped, q, h)
                if dt > 0:
                    mapped, _expansion = law.return_mapping(h, read_expansion(P, law, q), p, dt)
                    write_list(T.mapped, q, mapped)
                write_list(T.tau, q, law.stress(read_list(T.mapped, q), p))
            else:
                write_list(T.tau, q, law.stress(h, p))


@ti.func
def read_expansion(P: ti.template(), law: ti.template(), q):
    """Return the volume correction of a pack (or its adjoint); 0 for a law that has none."""
    if ti.static(law.has_volume_correction):
        return P.vc[q]
    else:
        return P.e[0][q] * 0.0


@ti.func
def stress_back(P: ti.template(), B: ti.template(), T: ti.template(), law: ti.template(), q, dt, C: ti.template(),
                p: ti.template()):
    """Turn the adjoints of pack q's state after the substep, in B, into those before it.
    P holds the state before, T what `recompute` stored and the adjoint of the stress. Returns the adjoints of C (nine)
    and of the law's parameters."""
    tau_bar = read_list(T.tau, q)
    if ti.static(law.state == "volume"):
        j_bar, C_bar, p_bar = law.stress_back(once(T.j[0][q]), C, p, tau_bar)
        d = dt * (C[0] + C[4] + C[8])
        growth = 1.0 + volume_growth(d)
        total = ti.select(T.j[0][q] > LEAST_RATIO - 1.0, B.j[q] + j_bar, 0.0)
        rate = dt * (1.0 + P.j[q]) * growth / ti.sqrt(1.0 + d * d) * total
        B.j[q] = total * growth
        for i in ti.static((0, 4, 8)):
            C_bar[i] += rate
        return C_bar, p_bar
    else:
        trial_bar, p_bar = trial_back(P, B, T, law, q, dt, p, tau_bar)
        e_bar, a_bar = advance_back([once(P.e[i][q]) for i in range(6)], [once(dt * C[i]) for i in range(9)], trial_bar)
        write_list(B.e, q, e_bar)
        return [once(dt * a_bar[i]) for i in range(9)], p_bar


@ti.func
def numbers_back(a: ti.template(), law: ti.template(), q, density, p: ti.template(), bar: ti.template()):
    """Adjoint of `numbers_of`: return that of a law's numbers, and add that of the density around pack q."""
    if ti.static(stiffens_with_density(law)):
        p_bar, firm_bar = law.soften_back(p, firmness(a.fields, a.fields.particles, q, density), bar)
        a.bars.around[q] = a.bars.around[q] \
            + firm_bar * share_slope(a.fields.particles.around[q], density * ti.static(a.fields.cell**3))
        return p_bar
    else:
        return bar


@ti.func
def share_slope(around, full):
    """Return the derivative of `share_of` by the mass around particles [1/kg]; full: that in a packing."""
    return ti.select((LEAST * full < around) & (around < full), 0.0 * around + 1.0 / full, 0.0 * around)


@ti.func
def take_up_density_back(fields: ti.template(), P: ti.template(), B: ti.template(), q, density):
    """Adjoint of `take_up_density`; P holds the state before it."""
    before, after, full = P.around[q], density_to_take_up(P, q), density * ti.static(fields.cell**3)
    low, high = share_of(before / full), share_of(after / full)
    is_stiffer = ti.cast(low < high, fields.real)
    kept, kept_bar = ti.min(low / high, 1.0), 0.0 * before
    for i in ti.static(range(6)):
        kept_bar += is_stiffer * P.e[i][q] * B.e[i][q]
        B.e[i][q] = kept * B.e[i][q]
    moved = ti.select(after == before, 0.0, ti.select(after > before, 1.0 / (1.0 + CHANGE), 1.0 / (1.0 - CHANGE)))
    bar = B.around[q] - share_slope(after, full) * kept_bar * kept / high
    B.around[q] = ti.cast(after == before, fields.real) * bar + share_slope(before, full) * kept_bar / high
    B.noted[q] = B.noted[q] + moved * bar


@ti.func
def advance_back(e: ti.template(), a: ti.template(), bar: ti.template()):
    """Return (e_bar, a_bar) of `advance_cauchy_green`: with F = I + a, M of bar, F^T M F and 2 M F (I + e)."""
    F = [once(a[i] + (1.0 if ti.static(i % 4 == 0) else 0.0)) for i in range(9)]
    b = [once(e[FULL[i]] + (1.0 if ti.static(i % 4 == 0) else 0.0)) for i in range(9)]
    MF = multiply(matrix_of_bar(bar), F)
    MFb = multiply(MF, b)
    return bar_of_matrix(multiply(transpose(F), MF)), [once(2.0 * MFb[i]) for i in range(9)]


@ti.func
def trial_back(P: ti.template(), B: ti.template(), T: ti.template(), law: ti.template(), q, dt, p: ti.template(),
               tau_bar: ti.template()):
    """Return the adjoints of the trial state (six) and of the law's parameters."""
    e_bar = read_list(B.e, q)
    if ti.static(law.state == "cauchy_green"):
        from_stress, p_bar = law.stress_back(read_list(T.trial, q), p, tau_bar)
        return [once(from_stress[i] + e_bar[i]) for i in range(6)], p_bar
    elif ti.static(not law.plastic):
        h_bar, p_bar = law.stress_back(read_list(T.h, q), p, tau_bar)
        from_stress = logarithm_back(read_list(T.d, q), read_list(T.v, q), h_bar, T.svd)
        return [once(from_stress[i] + e_bar[i]) for i in range(6)], p_bar
    else:
        mapped, v = read_list(T.mapped, q), read_list(T.v, q)
        from_stress, elastic_bar = law.stress_back(mapped, p, tau_bar)
        from_state = exponential_back(mapped, v, e_bar)  # an isotropic law keeps the axes
        h_bar, expansion_bar, p_bar = law.return_mapping_back(
            read_list(T.h, q), read_expansion(P, law, q), p, dt,
            [once(from_stress[i] + from_state[i]) for i in range(6)], read_expansion(B, law, q), T.soft)
        if ti.static(law.has_volume_correction):
            B.vc[q] = ti.select(dt > 0, expansion_bar, B.vc[q])
        through = logarithm_back(read_list(T.d, q), v, [once(ti.select(dt > 0, h_bar[i], from_stress[i]))
                                                        for i in range(6)], T.svd)
        mapped_bar = [once(ti.select(dt > 0, p_bar[i], 0.0 * p_bar[i])) for i in range(len(p_bar))]
        for i in ti.static(range(2)):
            mapped_bar[i] += elastic_bar[i]
        return [once(through[i] + ti.select(dt > 0, 0.0 * e_bar[i], e_bar[i])) for i in range(6)], mapped_bar
