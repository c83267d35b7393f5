"""Cost of a randomized reset: what is compiled later is counted, and times are of the resets alone."""

import pytest

from robosim.studies.benchmarks import KINDS
from robosim.studies.benchmarks.resets import measure_resets

BAR = 1.2
"""Ratio of a randomized reset to a nominal one that is wanted."""
BOUNDS = {"alone": 1.2 * 1.16, "arm": 1.2 * 1.27, "vector": 1.2 * 1.34}
"""A fifth above what was measured, so that a regression by a quarter fails."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_randomized_reset_compiles_nothing_and_costs_little_more(kind: str) -> None:
    """Six episodes, six times each, after one that settles their starts; `robosim bench` gives the figures."""
    milliseconds, ratio, compiled = measure_resets("SpoonPour", kind, turns=6).values()
    assert compiled == 0
    assert 0.0 < milliseconds < 100.0
    assert ratio < BOUNDS[kind], f"{kind}: {ratio:.2f}; wanted: at most {BAR}"
