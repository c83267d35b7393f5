"""Launches through a `Launcher` do what a call of the kernel does, with whatever arguments come next."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import mpm
from mpm.backend import allocating, ti
from mpm.backend.launching import Launcher
from mpm.errors import BackendError


@ti.data_oriented
class Recorder:
    """Writes what its kernel was given to an array."""

    def __init__(self) -> None:
        with allocating():
            self.launches = ti.field(ti.i32, ())

    @ti.kernel
    def record(self, count: ti.i32, values: ti.types.ndarray(), dt: float, out: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.launches[None] += 1
            for i in range(count):
                out[i] = values[i] * dt
            out[count] = self.launches[None]


@pytest.fixture(scope="module")
def recorder() -> Recorder:
    mpm.init()
    return Recorder()


def test_arguments_that_change_arrive(recorder):
    launch, first = Launcher(recorder, Recorder.record), recorder.launches[None]
    out, values = np.zeros(4), np.array([1.0, 2.0, 3.0])
    launch(3, values, 0.5, out)
    np.testing.assert_array_equal(out, [0.5, 1.0, 1.5, first + 1])
    launch(3, values, 0.5, out)
    np.testing.assert_array_equal(out, [0.5, 1.0, 1.5, first + 2])
    launch(2, np.array([5.0, 6.0]), 2.0, out)
    np.testing.assert_array_equal(out, [10.0, 12.0, first + 3, first + 2])
    values[:] = 7.0
    other = np.zeros(9)
    launch(3, values, -0.0, other)
    np.testing.assert_array_equal(other[:4], [0.0, 0.0, 0.0, first + 4])
    launch(3, values, float("nan"), other)
    assert np.isnan(other[:3]).all()
    launch(3, values, 1.0, other)
    np.testing.assert_array_equal(other[:3], 7.0)


def test_arrays_of_other_types_have_a_version_of_their_own(recorder):
    launch, first = Launcher(recorder, Recorder.record), recorder.launches[None]
    for turn, kind in enumerate((np.float64, np.float32, np.float64, np.int32)):
        out = np.zeros(3)
        launch(2, np.array([1.25, 3.5]).astype(kind), 2.0, out)
        np.testing.assert_array_equal(out, [*(2.0 * np.array([1.25, 3.5]).astype(kind)), first + turn + 1])


def test_an_array_is_held_until_the_next_takes_its_place(recorder):
    launch = Launcher(recorder, Recorder.record)
    out = np.zeros(3)
    launch(2, np.full(2, 1.0), 1.0, out)
    for turn in range(50):
        launch(2, np.full(2, float(turn)), 1.0, out)  # nobody else holds this array
        np.testing.assert_array_equal(out[:2], turn)


def test_an_array_that_is_not_contiguous_is_refused(recorder):
    launch = Launcher(recorder, Recorder.record)
    values, out = np.arange(6.0), np.zeros(4)
    launch(3, values[:3], 1.0, out)
    with pytest.raises(ValueError, match="argument 1 of a kernel.*contiguous"):
        launch(3, values[::2], 1.0, out)


def test_another_thread_is_refused(recorder):
    launch, arguments = Launcher(recorder, Recorder.record), (1, np.ones(1), 1.0, np.zeros(2))
    launch(*arguments)
    with ThreadPoolExecutor() as pool, pytest.raises(BackendError, match="thread"):
        pool.submit(launch, *arguments).result()
