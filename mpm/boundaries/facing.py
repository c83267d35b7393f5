"""Contact state of a node next to a solid: whether its material touches a face of the solid.
A node carries the mass of all particles within 1.5 cells. Beside a block that lies flush on a bed, nodes at the level
of the bed's surface carry the bed's mass: if it were stopped at the block's side, the bed would hold the block.
Material touches a face if some of its particles do, and if the nodes' mass grows along the face's normal, as in front
of a wall; at a sharp edge, along the normal of the material's surface."""

from mpm.backend import ti
from mpm.boundaries.periodic import home_node
from mpm.scene.grid import BLOCK

FACE = 0.51
"""Cells in front of a collider's face within which a node counts as on it. Half a cell puts the walls that nodes can
make on average where the face is: the impact on a bar is right to 2 % instead of 11 %. With a whole cell, as for
shells, an elastic bed under a block would settle 9 % too little, as its top layer is held."""
FACING = 0.37
"""Least difference of the masses of the nodes in front and behind along a face's normal, relative to their sum, that
counts as contact. It is 0.7 to 1 for material that fills the space in front of a face, and 0 beside a lip; a
block that has sunk by half a cell meets what lies at its sides."""
FACING_EDGE = 0.1
"""The same at an edge, in the direction in which the masses grow: material on three sides of four gives 0.2 to 0.3. A
fluid would creep in at edges that do not hold it, and the thrust on a cube of ten cells be 4 to 6 % too low."""
LIGHT_NODE = 0.2
"""Mass of a node relative to its heaviest neighbour, below which the masses about that neighbour decide. Such a node
lies half a cell or more away from the material, and its mass comes from few particles."""
SHARP = 0.85
"""Depth at a small distance behind the closest place of a solid, relative to that distance, below which this place lies
on an edge. It is 1 behind a face and 0.7 behind a right angle."""
BEHIND = 0.25  # this distance [cells]


class GridNodes:
    """The nodes of the grid as they are."""

    @ti.func
    def mass(self, fields: ti.template(), J):
        """Return the mass [kg] of a node."""
        return fields.grid.nodes[J][3]


GRID_NODES = GridNodes()


@ti.func
def is_at_edge(solid: ti.template(), y, normal, phi, cell: ti.template()):
    """Return whether the place of a solid that is closest to y (3,), outside at the distance phi, lies on an edge.
    normal: of the solid at y, in its frame, as y."""
    result = False
    if phi > 0:
        _n, inner = solid.at(y - normal * (phi + BEHIND * cell))
        result = inner > -SHARP * BEHIND * cell
    return result


@ti.func
def node_mass(fields: ti.template(), nodes: ti.template(), I, stamp):
    """Return the mass [kg] of a node at the begin of a stride, negative where it was folded at a wall.
    nodes: values of nodes, such as `GridNodes`."""
    mass = ti.cast(0.0, fields.real)
    J = I
    if ti.static(fields.is_periodic):
        J = home_node(fields, I)
    if fields.grid.stamp[J // BLOCK] == stamp:
        mass = nodes.mass(fields, J)
    return mass


@ti.func
def masses_about(fields: ti.template(), nodes: ti.template(), I, stamp):
    """Return the masses [kg] of node I, and of the next nodes above and below it along each axis (3,).
    stamp: of the substep, which the block of a node with mass has."""
    here = node_mass(fields, nodes, I, stamp)
    above, below = ti.Vector.zero(fields.real, 3), ti.Vector.zero(fields.real, 3)
    for d in ti.static(range(3)):
        e = ti.Vector([int(c == d) for c in range(3)])
        above[d], below[d] = node_mass(fields, nodes, I + e, stamp), node_mass(fields, nodes, I - e, stamp)
        if above[d] < 0:  # a wall mirrors what is in front of it
            above[d] = below[d]
        if below[d] < 0:
            below[d] = above[d]
    return here, above, below


@ti.func
def deciding_node(fields: ti.template(), nodes: ti.template(), I):
    """Return the neighbour whose mass decides the contact face of node I, and the masses on both sides."""
    stamp = fields.grid.stamp[I // BLOCK]
    J = I
    here, above, below = masses_about(fields, nodes, I, stamp)
    most = ti.max(above.max(), below.max())
    if here < LIGHT_NODE * most:
        e = 0 * I
        for d in ti.static(range(3)):
            if ti.max(above[d], below[d]) == most:
                e = ti.Vector([int(c == d) for c in range(3)]) * ti.select(above[d] == most, 1, -1)
        if node_mass(fields, nodes, I + e, stamp) < 0:  # beyond a wall, which mirrors the other one
            e = -e
        J = I + e
        here, above, below = masses_about(fields, nodes, J, stamp)
    return J, here, above, below


@ti.func
def growth_along(normal, here, above, below):
    """Return how much nodal mass grows along a normal, from 0 to 1; see `masses_about`.
    A layer thinner than a cell is heaviest at the node itself."""
    front, behind, share = 0.0 * here, 0.0 * here, 0.0 * here
    for d in ti.static(range(3)):
        w = ti.abs(normal[d])
        front += w * (above[d] if normal[d] > 0 else below[d])
        behind += w * (below[d] if normal[d] > 0 else above[d])
        share += w
    most = ti.max(front, share * here)
    return (most - behind) / ti.max(most + behind, 1e-30)


@ti.func
def has_touching_grains(fields: ti.template(), row: ti.template(), I):
    """Return whether some particle with mass at node I touches a solid in this stride, see `note_touching`; after
    `find_contact`, whether the node's material does."""
    return fields.grid.touching[row, I[0], I[1], I[2]] == fields.grid.stamp[I // BLOCK]


@ti.func
def forget_touching(fields: ti.template(), row: ti.template(), I):
    """Decide that the material of node I does not touch a solid in this stride."""
    fields.grid.touching[row, I[0], I[1], I[2]] = fields.grid.stamp[I // BLOCK] - 1


@ti.func
def touches_static(fields: ti.template(), I, normal):
    """Return whether the material of node I touches a face of normal (3,), away from edges."""
    _J, here, above, below = deciding_node(fields, GRID_NODES, I)
    return growth_along(normal, here, above, below) > FACING


@ti.func
def touched_face(fields: ti.template(), I, solid: ti.template(), R, y):
    """Return the normal of the face of a solid that the material of node I touches, see `GridFields.face`, or zeros.
    R: the solid's axes; y: the node in its frame. Inside a solid the closest face can be one without material, and at
    an edge it is none: there the material's own surface decides."""
    result, of_material = 0.0 * y, False
    n_t, phi = solid.at(y)
    if phi < FACE * fields.cell:
        J, here, above, below = deciding_node(fields, GRID_NODES, I)
        normal = R @ n_t
        is_facing = growth_along(normal, here, above, below) > FACING
        of_material = (not is_facing and phi < 0) or is_at_edge(solid, y, n_t, phi, fields.cell)
        if of_material:
            normal = (above - below) / (above - below).norm(1e-30)
            _n, beyond = solid.at(y + fields.cell * (R.transpose() @ (ti.cast(J - I, fields.real) + normal)))
            is_facing = growth_along(normal, here, above, below) > FACING_EDGE and beyond > 0
        if is_facing:
            result = normal
    return ti.Vector([result[0], result[1], result[2], ti.cast(of_material, fields.real)])
