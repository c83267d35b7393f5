"""What a pack of grains remembers, advanced by one substep, and the stress that follows from it."""

from mpm.backend import ti
from mpm.materials.hencky_strain import advance_e, keep


@ti.func
def stress(scene: ti.template(), P: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
    """Kirchhoff stress [Pa] of pack q, by the kind of state that its law asks for."""
    if ti.static(law.state == "volume"):
        P.j[q] = P.j[q] + dt * (1.0 + P.j[q]) * (C[0] + C[4] + C[8])
        return law.stress(keep(P.j[q]), C, p)
    elif ti.static(law.state == "cauchy_green"):
        e = trial(P, q, dt, C)
        for i in ti.static(range(6)):
            P.e[i][q] = e[i]
        return law.stress(e, p)
    elif ti.static(not law.plastic):
        e = trial(P, q, dt, C)
        for i in ti.static(range(6)):
            P.e[i][q] = e[i]
        return law.stress(scene.logarithm(e), p)
    else:
        return plastic_stress(scene, P, law, q, dt, C, p)


@ti.func
def trial(P: ti.template(), q, dt, C: ti.template()):
    """e of pack q as if the substep were elastic."""
    return advance_e([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)])


@ti.func
def plastic_stress(scene: ti.template(), P: ti.template(), law: ti.template(), q, dt, C: ti.template(),
                   p: ti.template()):
    """Return mapping on the Hencky strain, written back to e; the stress."""
    remembered = C[0] * 0.0
    if ti.static(law.has_volume_correction):
        remembered = P.vc[q]
    h, expansion = law.return_mapping(scene.logarithm(trial(P, q, dt, C)), remembered, p)
    if ti.static(law.has_volume_correction):
        P.vc[q] = expansion
    back = scene.exponential(h)
    for i in ti.static(range(6)):
        P.e[i][q] = back[i]
    return law.stress(h, p)
