"""Adjoint of the constitutive update: from the bars of stress and new state to those of old state and strain rate."""

from mpm.adjoint.strain import advance_back, exponential_back, logarithm_back
from mpm.backend import ti
from mpm.strain import advance_e, compose, keep, log1p, spectrum


@ti.func
def revisit(P: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
    """Stress of pack q from the state before the substep, which stays; and what it was found through."""
    if ti.static(law.state == "volume"):
        j = P.j[q] + dt * (1.0 + P.j[q]) * (C[0] + C[4] + C[8])
        return law.stress(j, C, p), [j]
    else:
        trial = advance_e([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)])
        if ti.static(law.state == "cauchy_green"):
            return law.stress(trial, p), [trial]
        else:
            d, v = spectrum(trial)
            h = compose([keep(0.5 * log1p(d[i])) for i in range(3)], v)
            if ti.static(law.plastic):
                kept, _expansion = law.return_mapping(h, memory(P, law, q), p)
                return law.stress(kept, p), [d, v, h, kept]
            else:
                return law.stress(h, p), [d, v, h]


@ti.func
def memory(P: ti.template(), law: ti.template(), q):
    """The volume correction of a pack (or its bar); 0 for a law that has none."""
    if ti.static(law.has_volume_correction):
        return P.vc[q]
    else:
        return P.e[0][q] * 0.0


@ti.func
def stress_back(P: ti.template(), B: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template(),
                through: ti.template(), tau_bar: ti.template()):
    """Turn the bars of pack q's state after the substep, in B, into those before it; returns the bars of C (nine) and
    of the law's numbers. P holds the state before, `through` is what `revisit` went through."""
    if ti.static(law.state == "volume"):
        j_bar, C_bar, p_bar = law.stress_back(through[0], C, p, tau_bar)
        total = B.j[q] + j_bar
        rate = dt * (1.0 + P.j[q]) * total
        B.j[q] = total * (1.0 + dt * (C[0] + C[4] + C[8]))
        for i in ti.static((0, 4, 8)):
            C_bar[i] += rate
        return C_bar, p_bar
    else:
        trial_bar, p_bar = trial_back(P, B, law, q, p, through, tau_bar)
        e_bar, a_bar = advance_back([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)], trial_bar)
        for i in ti.static(range(6)):
            B.e[i][q] = e_bar[i]
        return [keep(dt * a_bar[i]) for i in range(9)], p_bar


@ti.func
def trial_back(P: ti.template(), B: ti.template(), law: ti.template(), q, p: ti.template(), through: ti.template(),
               tau_bar: ti.template()):
    """Bars of the trial state (six) and of the law's numbers."""
    e_bar = [keep(B.e[i][q]) for i in range(6)]
    if ti.static(law.state == "cauchy_green"):
        from_stress, p_bar = law.stress_back(through[0], p, tau_bar)
        return [keep(from_stress[i] + e_bar[i]) for i in range(6)], p_bar
    elif ti.static(not law.plastic):
        h_bar, p_bar = law.stress_back(through[2], p, tau_bar)
        from_stress = logarithm_back(through[0], through[1], h_bar)
        return [keep(from_stress[i] + e_bar[i]) for i in range(6)], p_bar
    else:
        from_stress, elastic_bar = law.stress_back(through[3], p, tau_bar)
        from_state = exponential_back(through[3], through[1], e_bar)  # an isotropic law keeps the axes
        h_bar, memory_bar, p_bar = law.return_mapping_back(
            through[2], memory(P, law, q), p, [keep(from_stress[i] + from_state[i]) for i in range(6)],
            memory(B, law, q))
        if ti.static(law.has_volume_correction):
            B.vc[q] = memory_bar
        for i in ti.static(range(2)):
            p_bar[i] += elastic_bar[i]
        return logarithm_back(through[0], through[1], h_bar), p_bar
