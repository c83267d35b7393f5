"""The layers of the grid that the adjoints of transfers mean, for particles with a side of a shell and without."""

from typing import Any, NamedTuple

from mpm.backend import ti
from mpm.state.fields import Fields
from mpm.state.stencil import SingleLayer


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
