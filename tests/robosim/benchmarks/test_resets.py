"""Cost of a randomized reset: what is compiled later is counted, and times are of the resets alone."""

import pytest

from robosim.benchmarks import KINDS
from robosim.benchmarks.resets import measure_resets


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_randomized_reset_compiles_nothing_and_costs_little_more(kind: str) -> None:
    """The bound leaves room for other processes; `robosim bench` gives the figure."""
    milliseconds, ratio, compiled = measure_resets("SpoonPour", kind, seeds=2, turns=6).values()
    assert compiled == 0
    assert 0.0 < milliseconds < 100.0
    assert 0.5 < ratio < 2.0
