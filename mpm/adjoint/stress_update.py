"""Adjoint of the constitutive update: from the bars of stress and new state to those of old state and strain rate."""

from mpm.backend import real_type, ti
from mpm.materials.hencky_strain import JACOBI_SWEEPS, advance_e, compose, keep, log1p, spectrum
from mpm.materials.strain_adjoint import advance_back, exponential_back, logarithm_back
from mpm.scene.body import Material
from mpm.state.packs import LANES

SWEEPS = {"f32": 4, "f64": JACOBI_SWEEPS}
"""Of Jacobi's rotations, to rounding: eigenvalues of 10 000 random tensors, coinciding ones among them, to 3e-7."""


class Through:
    """What the constitutive update of every pack went through, on its way to the adjoint.

    svd: divided differences as autodiff through a singular value decomposition forms them. soft: of the yield surface.
    """

    def __init__(self, laws: list[Material], n_packs: int, precision: str, *, svd: bool = False,
                 soft: float = 0.0) -> None:
        def packs(n: int, wanted: bool) -> list:
            return [ti.Vector.field(LANES, real_type(precision), n_packs) for _ in range(n if wanted else 0)]

        self.sweeps, self.svd, self.soft = SWEEPS[precision], svd, soft
        states = {law.state for law in laws}
        self.tau = packs(6, True)
        """Stress / Pa, and then its bar."""
        self.j = packs(1, "volume" in states)
        self.trial = packs(6, "cauchy_green" in states)
        self.d, self.v, self.h = (packs(n, "hencky" in states) for n in (3, 9, 6))
        """Eigenvalues and eigenvectors of the trial e, and the trial strain."""
        self.kept = packs(6, any(getattr(law, "plastic", False) for law in laws))
        """Strain after the return mapping."""


@ti.func
def store(fields: ti.template(), q, values: ti.template()):
    """A list of packs into a list of fields."""
    for i in ti.static(range(len(fields))):
        fields[i][q] = values[i]


@ti.func
def stored(fields: ti.template(), q):
    """A list of packs from a list of fields."""
    return [keep(fields[i][q]) for i in range(len(fields))]


@ti.func
def revisit(P: ti.template(), T: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
    """The constitutive update of pack q from the state before the substep, which stays, into T."""
    if ti.static(law.state == "volume"):
        T.j[0][q] = P.j[q] + dt * (1.0 + P.j[q]) * (C[0] + C[4] + C[8])
        store(T.tau, q, law.stress(keep(T.j[0][q]), C, p))
    else:
        trial = advance_e([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)])
        if ti.static(law.state == "cauchy_green"):
            store(T.trial, q, trial)
            store(T.tau, q, law.stress(trial, p))
        else:
            d, v = spectrum(trial, ti.static(T.sweeps))
            h = compose([keep(0.5 * log1p(d[i])) for i in range(3)], v)
            store(T.d, q, d)
            store(T.v, q, v)
            store(T.h, q, h)
            if ti.static(law.plastic):
                kept, _expansion = law.return_mapping(h, memory(P, law, q), p)
                store(T.kept, q, kept)
                store(T.tau, q, law.stress(kept, p))
            else:
                store(T.tau, q, law.stress(h, p))


@ti.func
def memory(P: ti.template(), law: ti.template(), q):
    """The volume correction of a pack (or its bar); 0 for a law that has none."""
    if ti.static(law.has_volume_correction):
        return P.vc[q]
    else:
        return P.e[0][q] * 0.0


@ti.func
def stress_back(P: ti.template(), B: ti.template(), T: ti.template(), law: ti.template(), q, dt, C: ti.template(),
                p: ti.template()):
    """Turn the bars of pack q's state after the substep, in B, into those before it; returns the bars of C (nine) and
    of the law's numbers. P holds the state before, T what `revisit` went through and the bar of the stress."""
    tau_bar = stored(T.tau, q)
    if ti.static(law.state == "volume"):
        j_bar, C_bar, p_bar = law.stress_back(keep(T.j[0][q]), C, p, tau_bar)
        total = B.j[q] + j_bar
        rate = dt * (1.0 + P.j[q]) * total
        B.j[q] = total * (1.0 + dt * (C[0] + C[4] + C[8]))
        for i in ti.static((0, 4, 8)):
            C_bar[i] += rate
        return C_bar, p_bar
    else:
        trial_bar, p_bar = trial_back(P, B, T, law, q, p, tau_bar)
        e_bar, a_bar = advance_back([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)], trial_bar)
        store(B.e, q, e_bar)
        return [keep(dt * a_bar[i]) for i in range(9)], p_bar


@ti.func
def trial_back(P: ti.template(), B: ti.template(), T: ti.template(), law: ti.template(), q, p: ti.template(),
               tau_bar: ti.template()):
    """Bars of the trial state (six) and of the law's numbers."""
    e_bar = stored(B.e, q)
    if ti.static(law.state == "cauchy_green"):
        from_stress, p_bar = law.stress_back(stored(T.trial, q), p, tau_bar)
        return [keep(from_stress[i] + e_bar[i]) for i in range(6)], p_bar
    elif ti.static(not law.plastic):
        h_bar, p_bar = law.stress_back(stored(T.h, q), p, tau_bar)
        from_stress = logarithm_back(stored(T.d, q), stored(T.v, q), h_bar, T.svd)
        return [keep(from_stress[i] + e_bar[i]) for i in range(6)], p_bar
    else:
        kept, v = stored(T.kept, q), stored(T.v, q)
        from_stress, elastic_bar = law.stress_back(kept, p, tau_bar)
        from_state = exponential_back(kept, v, e_bar)  # an isotropic law keeps the axes
        h_bar, memory_bar, p_bar = law.return_mapping_back(
            stored(T.h, q), memory(P, law, q), p, [keep(from_stress[i] + from_state[i]) for i in range(6)],
            memory(B, law, q), T.soft)
        if ti.static(law.has_volume_correction):
            B.vc[q] = memory_bar
        for i in ti.static(range(2)):
            p_bar[i] += elastic_bar[i]
        return logarithm_back(stored(T.d, q), v, h_bar, T.svd), p_bar
