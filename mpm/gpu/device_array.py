"""Arrays of a launch on the device of a GPU."""

import numpy as np

from mpm.backend import ti
from mpm.state.ledger import add_stripes


class DeviceArray:
    """A host array, and during a launch its copy on the device; or several, into which a ledger is summed: `Stripe`."""

    def __init__(self, array: np.ndarray, copies: int = 1) -> None:
        self.array, self.copies = array, copies
        self.device = ti.ndarray(ti.f64 if array.dtype == np.float64 else ti.f32,
                                 (copies * array.shape[0], *array.shape[1:]))
        self.device.from_numpy(array if copies == 1 else np.zeros(self.device.shape, array.dtype))

    def fetch(self, status: int) -> None:
        """Copy what was written to the host array, or add what was added; status: row with the largest speed."""
        values = self.device.to_numpy()
        if self.copies == 1:
            self.array[:] = values
        else:
            add_stripes(self.array, values, status)
