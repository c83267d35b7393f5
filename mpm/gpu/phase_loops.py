"""Phases of a substep as parallel loops of a GPU, in one kernel."""

from collections.abc import Sequence
from typing import Any

from mpm.backend import is_vulkan, ti
from mpm.scene.grid import BLOCK
from mpm.state.fields import Fields
from mpm.state.ledger import STRIPES, Stripe
from mpm.stepping.phases import Phase, Step
from mpm.stepping.thread_group import count_of

WALLS = 6
BLOCK_PARTS = 4096
"""Parts of the list of active blocks, of a thread a node each."""
TEAM = 256
"""Threads that solve the contact of mobile colliders together, where barriers order what they write: not in Vulkan."""
GROUP = 64
"""Threads that are started together."""


@ti.data_oriented
class PhaseLoops:
    """Phases that follow each other, compiled to one kernel."""

    def __init__(self, fields: Fields, phases: Sequence[Phase]) -> None:
        self.fields, self.phases = fields, tuple(phases)
        self.team = 1 if is_vulkan() else TEAM
        self.n_packs, self.n_lanes = fields.particles.n_packs, fields.particles.n_lanes
        self.block_parts = min(fields.grid.active.shape[0], BLOCK_PARTS)
        """Parts of the active blocks."""
        self.rows = fields.grid.stamp.shape[0] * fields.grid.stamp.shape[1]
        """Rows of the grid of blocks."""

    @ti.kernel
    def run(self, row: ti.i32, stamp: ti.i32, dt: float, kick: float, strain: float, stride: float,
            motion: ti.types.ndarray(), mobile: ti.types.ndarray(), out: ti.types.ndarray(), transfer_mass: ti.i32,
            span: ti.i32, runs: ti.i32):
        """Run the phases in one substep, see `Step`; runs: 0 to do nothing."""
        alone = ti.static(Step(row, stamp, dt, kick, strain, transfer_mass, span, stride, motion, mobile,
                               ledger_of(out, 0)))
        for phase in ti.static(self.phases):
            if ti.static(phase.over == "team"):
                ti.loop_config(block_dim=self.team)
                for thread in range(ti.static(self.team)):
                    step = ti.static(alone._replace(thread=thread, threads=self.team))
                    if runs > 0:
                        phase.run(self.fields, step, 0, 1)
            elif ti.static(phase.over in ("once", "entering in order")):
                ti.loop_config(serialize=True)
                for _ in range(runs):
                    phase.run(self.fields, alone, 0, count_of(self.fields, phase.over))
            elif ti.static(phase.over == "rows"):
                for r in range(ti.static(self.rows)):
                    if runs > 0:
                        phase.run(self.fields, alone, r, r + 1)
            elif ti.static(phase.over == "walls"):
                for w in ti.static(range(WALLS)):
                    ti.loop_config(block_dim=GROUP)
                    for turn in range(ti.static(self.block_parts * BLOCK**2)):
                        first, last = self.blocks_of(turn // BLOCK**2)
                        step = ti.static(alone._replace(out=ledger_of(out, turn), column=turn % BLOCK**2,
                                                        columns=BLOCK**2))
                        if runs > 0:
                            phase.run(self.fields, step, w, first, last)
            elif ti.static(phase.over == "blocks"):
                ti.loop_config(block_dim=GROUP)
                for turn in range(ti.static(self.block_parts * BLOCK**3)):
                    first, last = self.blocks_of(turn // BLOCK**3)
                    step = ti.static(alone._replace(out=ledger_of(out, turn), thread=turn % BLOCK**3, threads=BLOCK**3))
                    if runs > 0:
                        phase.run(self.fields, step, first, last)
            else:
                ti.loop_config(block_dim=GROUP)
                for place in range(ti.static(self.n_lanes if phase.over == "listed" else self.n_packs)):
                    step = ti.static(alone._replace(out=ledger_of(out, place)))
                    if runs > 0 and place < count_of(self.fields, phase.over):
                        phase.run(self.fields, step, place, place + 1)

    @ti.func
    def blocks_of(self, part):
        """Return the first and last + 1 active block of a part."""
        count = self.fields.grid.count[None]
        each = (count + self.block_parts - 1) // self.block_parts
        return ti.min(part * each, count), ti.min((part + 1) * each, count)


def ledger_of(out: Any, turn: Any) -> Stripe:
    """Return where a thread adds to the ledger, inside a kernel."""
    return Stripe(out, turn % STRIPES * (out.shape[0] // STRIPES))
