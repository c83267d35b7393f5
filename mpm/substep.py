"""One launch of the field: all substeps of a host step in one serial kernel, touching only blocks with material."""

from mpm.backend import ti
from mpm.contact import backstop, update_nodes
from mpm.grid import GHOST, clamped, mark_packs
from mpm.numbers import PARAMETERS
from mpm.strain import INTEGRATORS, advance_e, keep
from mpm.transfer import first_node, gather_lane, lane, scatter_lane, weights
from mpm.walls import fold, unfold, wall_table

SPEED_LIMIT = 1.0
"""Cells that a grain may travel in a substep before the run counts as diverged."""
FULL = (0, 3, 4, 3, 1, 5, 4, 5, 2)
"""Entry of a symmetric tensor's list for each of the nine places of the matrix, row by row."""


@ti.data_oriented
class Substeps:
    """The kernel of one solver; reads the solver's fields and features, both fixed."""

    first_collider_row = 2
    """Ledger rows: gravity, walls, then the colliders, then momentum and status."""

    def __init__(self, scene) -> None:  # noqa: ANN001  (a Solver; importing it here would be a cycle)
        self.particles, self.grid = scene.particles, scene.fields
        self.numbers = scene.numbers
        self.features, self.colliders = scene.features, scene.colliders
        self.node_contact, self.node_owner = scene.node_contact, scene.node_owner
        self.laws = [body.material for body in scene.bodies]
        table = wall_table(scene.walls, scene.grid)
        self.walls = ti.field(ti.i32, table.shape)
        self.walls.from_numpy(table)
        self.cell = scene.grid.cell
        self.origin = tuple(float(c) for c in scene.grid.origin)
        self.span = tuple(float(c) * self.cell for c in scene.grid.cells)
        self.corner = GHOST * self.cell
        self.logarithm, self.exponential = INTEGRATORS[scene.features.integrator]
        self.rows = self.first_collider_row + len(scene.colliders) + 2
        self.momentum, self.status = self.rows - 2, self.rows - 1

    @ti.kernel
    def run(self, substeps: ti.i32, first_stamp: ti.i32, dt: float, motion: ti.types.ndarray(),
            out: ti.types.ndarray()):
        """Advance by `substeps` of dt [s]; motion (k, substeps, 18) of the moving colliders; out: ledger and status."""
        ti.loop_config(serialize=True)
        for s in range(substeps):
            stamp = first_stamp + s
            gravity = self.numbers.gravity[None]
            corner = ti.Vector([ti.cast(self.origin[0], ti.f64), ti.cast(self.origin[1], ti.f64),
                                ti.cast(self.origin[2], ti.f64)])
            self.activate(stamp)
            for body in ti.static(range(len(self.laws))):
                self.to_grid(self.particles, self.laws[body], body, dt)
            fold(self.grid, self.walls, stamp, dt, gravity)
            update_nodes(self.grid, self, motion, s, dt, gravity, corner, self.cell, out)
            unfold(self.grid, self.walls, stamp, self.numbers.wall_friction[None], corner, self.cell, out)
            for body in ti.static(range(len(self.laws))):
                self.to_particles(self.particles, body, dt)
                if ti.static(len(self.features.moving_colliders) > 0):
                    backstop(self.particles, self.grid, self, motion, s, dt, self.origin, body, out)
            if s == substeps - 1:
                for body in ti.static(range(len(self.laws))):
                    self.take_momentum(self.particles, body, corner, out)
                self.take_status(out)

    @ti.func
    def activate(self, stamp: ti.i32):
        """List and clear the blocks that this substep touches."""
        self.grid.count[None] = 0
        mark_packs(self.grid, self.particles.x, self.particles.n_packs, 1.0 / self.cell, stamp)

    @ti.func
    def to_grid(self, P: ti.template(), law: ti.template(), body: ti.template(), dt):
        """Strain, plastic flow, stress; then momentum, mass and the stress's push to the grid."""
        p = [keep(self.numbers.parameters[body, i]) for i in range(PARAMETERS)]
        density = self.numbers.densities[body]
        force = -dt * 4.0 / (self.cell * self.cell)
        for q in range(P.ranges[body][0], P.ranges[body][1]):
            C = [keep(P.C[i][q]) for i in range(9)]
            tau = self.stress(P, law, q, dt, C, p)
            volume = P.volume[q]
            mass = density * volume
            self.spread(P, q, mass, force * volume, C, tau)

    @ti.func
    def stress(self, P: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
        """Advance what the material remembers, and return its Kirchhoff stress [Pa]."""
        if ti.static(law.state == "volume"):
            P.j[q] = P.j[q] + dt * (1.0 + P.j[q]) * (C[0] + C[4] + C[8])
            return law.stress(keep(P.j[q]), C, p)
        elif ti.static(law.state == "cauchy_green"):
            return self.tensor_stress(P, law, q, dt, C, p)
        else:
            return self.hencky_stress(P, law, q, dt, C, p)

    @ti.func
    def tensor_stress(self, P: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
        """Stress straight from b."""
        e = advance_e([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)])
        for i in ti.static(range(6)):
            P.e[i][q] = e[i]
        return law.stress(e, p)

    @ti.func
    def hencky_stress(self, P: ti.template(), law: ti.template(), q, dt, C: ti.template(), p: ti.template()):
        """Return mapping on the Hencky strain, written back to e; the stress."""
        e = advance_e([keep(P.e[i][q]) for i in range(6)], [keep(dt * C[i]) for i in range(9)])
        trial = self.logarithm(e)
        if ti.static(law.plastic):
            remembered = C[0] * 0.0
            if ti.static(law.has_volume_correction):
                remembered = P.vc[q]
            h, expansion = law.return_mapping(trial, remembered, p)
            if ti.static(law.has_volume_correction):
                P.vc[q] = expansion
            back = self.exponential(h)
            for i in ti.static(range(6)):
                P.e[i][q] = back[i]
            return law.stress(h, p)
        else:
            for i in ti.static(range(6)):
                P.e[i][q] = e[i]
            return law.stress(trial, p)

    @ti.func
    def spread(self, P: ti.template(), q, mass, force, C: ti.template(), tau: ti.template()):
        """Scatter a pack: affine momentum Q = force tau + mass C, per cell."""
        Q = [keep((force * tau[FULL[i]] + mass * C[i]) * self.cell) for i in range(9)]
        node_x, fx = first_node(P.x[0][q], 1.0 / self.cell)
        node_y, fy = first_node(P.x[1][q], 1.0 / self.cell)
        node_z, fz = first_node(P.x[2][q], 1.0 / self.cell)
        px = mass * P.v[0][q] - Q[0] * fx - Q[1] * fy - Q[2] * fz
        py = mass * P.v[1][q] - Q[3] * fx - Q[4] * fy - Q[5] * fz
        pz = mass * P.v[2][q] - Q[6] * fx - Q[7] * fy - Q[8] * fz
        wx, wy, wz = weights(fx), weights(fy), weights(fz)
        for l in ti.static(range(4)):
            scatter_lane(
                self.grid.nodes, clamped([node_x, node_y, node_z], l, self.grid.nodes),
                ti.Vector([px[l], py[l], pz[l], mass[l]]),
                ti.Vector([Q[0][l], Q[3][l], Q[6][l], 0.0]), ti.Vector([Q[1][l], Q[4][l], Q[7][l], 0.0]),
                ti.Vector([Q[2][l], Q[5][l], Q[8][l], 0.0]),
                lane(wx, l), lane(wy, l), lane(wz, l))

    @ti.func
    def to_particles(self, P: ti.template(), body: ti.template(), dt):
        """Velocity, affine velocity and position of every pack of a body."""
        for q in range(P.ranges[body][0], P.ranges[body][1]):
            node_x, fx = first_node(P.x[0][q], 1.0 / self.cell)
            node_y, fy = first_node(P.x[1][q], 1.0 / self.cell)
            node_z, fz = first_node(P.x[2][q], 1.0 / self.cell)
            wx, wy, wz = weights(fx), weights(fy), weights(fz)
            v = [keep(fx * 0.0) for _ in range(3)]
            B = [keep(fx * 0.0) for _ in range(9)]
            for l in ti.static(range(4)):
                value, moment_i, moment_j, moment_k = gather_lane(
                    self.grid.nodes, clamped([node_x, node_y, node_z], l, self.grid.nodes),
                    lane(wx, l), lane(wy, l), lane(wz, l))
                for r in ti.static(range(3)):
                    v[r][l] = value[r]
                    B[3 * r][l] = moment_i[r]
                    B[3 * r + 1][l] = moment_j[r]
                    B[3 * r + 2][l] = moment_k[r]
            gradient = 4.0 / self.cell
            f = [fx, fy, fz]
            for r in ti.static(range(3)):
                P.v[r][q] = v[r]
                # the clamp holds a grain that an inaccurate step would carry through a wall
                P.x[r][q] = ti.max(ti.min(P.x[r][q] + dt * v[r], self.corner + self.span[r]), self.corner)
                for c in ti.static(range(3)):
                    P.C[3 * r + c][q] = gradient * (B[3 * r + c] - v[r] * f[c])

    @ti.func
    def take_momentum(self, P: ti.template(), body: ti.template(), corner, out: ti.template()):
        """Momentum of a body's grains about the world's origin, affine part included."""
        density = self.numbers.densities[body]
        quarter = 0.25 * self.cell * self.cell
        for q in range(P.ranges[body][0], P.ranges[body][1]):
            spin = [keep(quarter * (P.C[7][q] - P.C[5][q])), keep(quarter * (P.C[2][q] - P.C[6][q])),
                    keep(quarter * (P.C[3][q] - P.C[1][q]))]
            for l in ti.static(range(4)):
                m = ti.cast(density * P.volume[q][l], ti.f64)
                x = ti.Vector([ti.cast(P.x[d][q][l], ti.f64) for d in range(3)]) + corner
                p = m * ti.Vector([ti.cast(P.v[d][q][l], ti.f64) for d in range(3)])
                moment = x.cross(p) + m * ti.Vector([ti.cast(spin[d][l], ti.f64) for d in range(3)])
                for d in ti.static(range(3)):
                    out[self.momentum, d] = out[self.momentum, d] + p[d]
                    out[self.momentum, 3 + d] = out[self.momentum, 3 + d] + moment[d]

    @ti.func
    def take_status(self, out: ti.template()):
        """Sum of squared velocities (not finite if anything is not) and the largest component."""
        total = ti.cast(0.0, ti.f64)
        fastest = ti.cast(0.0, ti.f64)
        for q in range(self.particles.n_packs):
            v2 = self.particles.v[0][q] ** 2 + self.particles.v[1][q] ** 2 + self.particles.v[2][q] ** 2
            total += ti.cast(v2.sum(), ti.f64)
            fastest = ti.max(fastest, ti.cast(v2.max(), ti.f64))
        out[self.status, 0] = total
        out[self.status, 1] = ti.sqrt(fastest)
