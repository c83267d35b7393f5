"""Ten thousand random steps at full range: nothing diverges, no grain gets away, memory stays as it is."""

import os
from pathlib import Path

import numpy as np
import pytest

from robosim.envs import TASKS
from robosim.envs.batch import GrainBatch

GROWTH = 8e6
"""Bytes by which a process may grow while episodes repeat themselves."""


def resident() -> int:
    """Bytes of this process in memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").is_file(), reason="memory is read from /proc")
@pytest.mark.parametrize("name", TASKS)
def test_ten_thousand_random_steps(name: str) -> None:
    """Ten episodes in two environments side by side."""
    both, rng = GrainBatch(name, 2), np.random.default_rng(0)
    both.reset([0, 1], None, np.ones(2, bool))
    solver = both.world.solver
    lower = np.asarray(solver.grid.lower)
    upper = lower + solver.grid.cells * solver.grid.cell
    before = ended = 0
    for k in range(500):
        seen, rewards, over, cut, _, finals = both.step(rng.uniform(-1, 1, (2, *both.action_space.shape)).astype("f4"))
        assert all(both.observation_space.contains(row) for row in seen) and np.isfinite(rewards).all()
        assert not any("diverged" in final["final_info"] for final in finals if final)
        ended += int((over | cut).sum())
        if k == 199:
            before = resident()
        if k % 100 == 98:  # the last state of an episode but one
            for e in range(2):
                both.batch.select(e)
                x, m = solver.positions(), solver.masses()
                assert np.isfinite(x).all() and np.all(x >= lower - 1e-6) and np.all(x <= upper + 1e-6)
                assert len(x) == both.world.task.grains.count and np.all(m > 0)
    assert ended == 10
    assert resident() - before < GROWTH
