"""Errors reach another process as they were raised: environments and sweeps run in processes of their own."""

import pickle

import pytest

import mpm.errors
import robosim.base.errors
from mpm.errors import ColliderTooFast, GradientDiverged, Picklable, SimulationDiverged, TimeStepTooLarge
from robosim.base.errors import DriverFault, RobotDiverged, UnreachableWaypoint

GIVEN = {
    mpm.errors.UnknownName: (("cone", "flat", ("compression", "plane_strain")), {}),
    robosim.base.errors.UnknownName: (("tool", "fork", ("spoon", "scoop"), "or a file"), {}),
    ColliderTooFast: ((1, 4e5, 2e3), {}),
    TimeStepTooLarge: ((2e-4, 1e-4, "isolated particle"), {}),
    SimulationDiverged: ((), {"time": 0.1, "step": 3, "particle": 7, "position": (0.0, 0.1, 0.2), "speed": 9.0,
                              "cfl": 2.0}),
    GradientDiverged: ((), {"step": 1, "substep": 2, "quantity": "x", "particle": -1}),
    UnreachableWaypoint: (("above", 0.01, 3.0, 0.2), {}),
    RobotDiverged: ((0.5, ["bad qacc"]), {}),
    DriverFault: (("mine", 0.5, "commands nothing", "joint angles"), {}),
}
"""Arguments of the constructors that take more than a message."""
CLASSES = [kind for module in (mpm.errors, robosim.base.errors) for kind in vars(module).values()
           if isinstance(kind, type) and issubclass(kind, Exception) and kind.__module__ == module.__name__]


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_every_error_survives_pickling(kind: type[Exception]) -> None:
    given, named = GIVEN.get(kind, (("what was given; what is accepted",), {}))
    error = kind(*given, **named)
    if isinstance(error, SimulationDiverged):
        error.diagnostics = {"mass": 1.0}  # given after it was made
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(error, protocol))
        assert type(again) is kind and str(again) == str(error) and again.args == error.args
        assert vars(again) == vars(error)


def test_every_error_of_ours_is_among_them() -> None:
    assert {mpm.MpmError, robosim.base.errors.RobosimError, *GIVEN, Picklable} <= set(CLASSES)
