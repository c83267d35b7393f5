"""The layers of the grid that the adjoints of transfers mean, for particles with a side of a shell and without."""

from typing import Any, NamedTuple

from mpm.backend import once, ti
from mpm.state.fields import Fields
from mpm.state.nodes import stencil
from mpm.state.stencil import NodeValues, SingleLayer, gather, moments, weights


class SideLayers(NamedTuple):
    """Nodes of the first layer, or of the second where a shell separates them from a particle; see `ShellLayers`."""

    grid: Any
    shells: Any
    side: Any
    """Label of the particle, 0 for one without a side."""

    @ti.func
    def node(self, base: ti.template(), i: ti.template(), j: ti.template(), k: ti.template()):
        """Return the index of the node at place (i, j, k) of the stencil that begins at `base`."""
        I = ti.Vector([base[0] + i, base[1] + j, base[2] + k])
        if self.side != 0 and self.shells.side[I] == -self.side:
            I[0] += self.grid.width
        return I


def layers_of(fields: Fields, side: Any) -> SingleLayer | SideLayers:
    """Return which nodes the stencil of a particle with a side means."""
    return SideLayers(fields.grid, fields.shells, side) if fields.shells is not None else SingleLayer()


@ti.func
def side_of(after: ti.template(), q, l):
    """Return the side of lane l of pack q during a substep: 0 in a scene without shells."""
    side = 0
    if ti.static(after.has_sides):
        side = ti.cast(after.side[q][l], ti.i32)
    return side


@ti.func
def gathered_velocity(a: ti.template(), P: ti.template(), q, l):
    """Return the velocity [m/s] (3,) that lane l of pack q gathers from the nodes, before solids and walls stop it."""
    node, f = stencil(a.fields.grid, [once(P.x[d][q][l] * (1.0 / a.fields.cell)) for d in range(3)])
    w = [weights(f[0]), weights(f[1]), weights(f[2])]
    value, _x, _y, _z = gather(ti.static(NodeValues(a.fields.grid.nodes, layers_of(a.fields, side_of(a.after, q, l)))),
                               node, a.fields.real, w, [moments(w[0]), moments(w[1]), moments(w[2])], 1)
    return ti.Vector([value[0], value[1], value[2]])
