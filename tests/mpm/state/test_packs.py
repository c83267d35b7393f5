"""Fields of packs, states set aside, and messages of kernels whose sources are cached."""

import numpy as np
import pytest

import mpm
from mpm.backend import allocating, put, ti
from mpm.state.packs import LANES, Packs
from mpm.stepping.snapshots import StateBank


@pytest.mark.parametrize("n, dtype", [(1, np.float32), (5, np.float32), (5, np.float64)])
def test_some_fields_are_written_and_read_and_the_others_left_alone(n: int, dtype: type) -> None:
    mpm.init()
    real = ti.f64 if dtype is np.float64 else ti.f32
    values = np.random.default_rng(n).normal(size=(4, n, LANES))
    with allocating():  # writes wait until the fields are laid out
        fields, count = [ti.Vector.field(LANES, real, n) for _ in range(4)], ti.field(ti.i32, ())
        put(count, np.array(n, np.int32))
        packs = Packs(fields, count, dtype)
        packs.write(fields, values)
    bank = StateBank(fields, count, 2)
    bank.store_now(1)
    packs.write([fields[3], fields[1]], -values[[0, 2]])
    expected = np.stack([values[0], -values[2], values[2], -values[0]]).astype(dtype)
    np.testing.assert_array_equal(packs.read(fields), expected)
    np.testing.assert_array_equal(packs.read(fields[2:0:-1]), expected[2:0:-1])
    np.testing.assert_array_equal(fields[1].to_numpy(), expected[1])
    packs.clear()
    assert not packs.read(fields).any()
    bank.restore_now(1)
    np.testing.assert_array_equal(packs.read(fields), values.astype(dtype))
    with pytest.raises(mpm.InvalidValue, match=r"shape \(1, "):
        packs.write(fields[:2], values[:1])
    with pytest.raises(mpm.InvalidValue, match="once each"):
        packs.read([fields[0], fields[0]])
    with pytest.raises(mpm.InvalidValue, match="2 fields given"):
        packs.read([fields[0], count])


def test_messages_still_show_the_line_at_fault() -> None:
    """Positions are cached: the second kernel's must not be the first one's."""
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
