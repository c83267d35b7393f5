"""Fields of packs, and what is remembered while kernels are traced."""

import numpy as np
import pytest

import mpm
from mpm.backend import ti
from mpm.packs import LANES, Packs, Snapshot


@pytest.mark.parametrize("n", [1, 5])
def test_some_fields_are_written_and_read_and_the_others_left_alone(n: int) -> None:
    mpm.init()
    fields, count = [ti.Vector.field(LANES, ti.f32, n) for _ in range(4)], ti.field(ti.i32, ())
    count[None] = n
    packs, values = Packs(fields, count, np.float32), np.random.default_rng(n).normal(size=(4, n, LANES))
    packs.write(fields, values)
    aside = Snapshot(packs)
    aside.keep()
    packs.write([fields[3], fields[1]], -values[[0, 2]])
    expected = np.stack([values[0], -values[2], values[2], -values[0]]).astype(np.float32)
    np.testing.assert_array_equal(packs.read(fields), expected)
    np.testing.assert_array_equal(packs.read(fields[2:0:-1]), expected[2:0:-1])
    np.testing.assert_array_equal(fields[1].to_numpy(), expected[1])
    packs.clear()
    assert not packs.read(fields).any()
    aside.rewind()
    np.testing.assert_array_equal(packs.read(fields), values.astype(np.float32))


def test_messages_still_show_the_line_at_fault() -> None:
    """Positions are remembered: the second kernel's must not be the first one's, nor one turn's another's."""
    mpm.init()

    @ti.kernel
    def first():
        for i in ti.static(range(3)):
            print(i, unknown_here)  # noqa: F821

    @ti.kernel
    def second():
        for i in ti.static(range(3)):
            print(i, i + another_one)  # noqa: F821

    for kernel, name in ((first, "unknown_here"), (second, "another_one"), (first, "unknown_here")):
        with pytest.raises(ti.TaichiCompilationError) as caught:
            kernel()
        message = str(caught.value)
        assert f'Name "{name}" is not defined' in message
        lines = message.splitlines()
        shown = next(k for k, text in enumerate(lines) if "print(i," in text)
        assert lines[shown].index(name) == lines[shown + 1].index("^")
        assert f"in {kernel.__name__}:" in message and __file__ in message
