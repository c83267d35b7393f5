"""Experiments as the search sees them: readings with their errors, and what would be read with other numbers.

Tilted tray, shear cell, cup and heaped scoop have a closed form. In steady simple shear the cone carries tau = m (sigma
+ c / tan phi), with m = 2 sqrt(3) sin(phi) / (3 - sin(phi)): the law's own ratio, which the verification cases `slope`
and `element_path` measure, and not tan(phi). c / tan(phi) is the tension of the cone's apex. So a number that is fitted
with these forms makes a simulation do what the sample did."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robosim.config.materials import number_names
from robosim.studies.calibration import data
from robosim.studies.calibration.flows import G, simulate_heap, simulate_pour
from robosim.studies.calibration.measurements import (
    WALL_FRICTION,
    CupExperiment,
    Experiment,
    HeapExperiment,
    Measurements,
    PourExperiment,
    ScoopExperiment,
    ShearExperiment,
    TiltExperiment,
)
from robosim.studies.verification.cases.beds import rim, shear_ratio

HEAP_ERROR = 0.25
"""Error of a simulated height in cells, unless `model_error` says otherwise: heaps of a column of sugar, 80 mm wide and
60 mm high, with 8 and with 16 cells on its radius differ by 1.2 mm, root mean square over their rings."""
POUR_ERROR = 0.01
"""Error of a simulated mass as a share of the mass in the box, unless `model_error` says otherwise."""
SCOOP_ERROR = 0.2
"""Error of the mass that a scoop holds above its rim, as a share of it, unless `model_error` says otherwise. Assumed:
that a heap slides as a layer of a third of the rim's radius has no source either."""

Numbers = dict[str, float]
"""Number of a material -> value in its unit; angles in degrees."""
Simulate = Callable[[Numbers, int], np.ndarray]
"""Returns what would be read (n,) with numbers of the material; the second argument is a seed."""


class Trial(NamedTuple):
    """An experiment: readings, and what would be read with other numbers."""

    name: str
    kind: str
    readings: np.ndarray
    """(n,) in `unit`, as `errors`: standard deviations of the readings and of the simulation's own error"""
    errors: np.ndarray
    simulate: Simulate
    is_direct: bool
    """Whether `simulate` is a closed form, which takes no time and needs no emulator."""
    held_out: bool
    axis: np.ndarray
    """(n,) what a plot has on its horizontal axis"""
    axis_name: str
    unit: str


def make_trial(measurements: Measurements, name: str, one: Experiment) -> Trial:
    """Read the data of an experiment; raises ConfigError for what cannot be used."""
    if isinstance(one, HeapExperiment):
        return _heap_trial(measurements, name, one, data.make_rings(name, one, data.read_heap(name, one)))
    if isinstance(one, PourExperiment):
        return _pour_trial(measurements, name, one, data.read_curve(name, one))
    given = {key: getattr(measurements.card, field).value for key, field in number_names(measurements.card).items()}
    readings = np.array(getattr(one, one.READS))

    def simulate(numbers: Numbers, seed: int) -> np.ndarray:
        return np.array(predict(one, given | numbers))

    axis, axis_name = np.arange(1.0, len(readings) + 1), "reading"
    if isinstance(one, ShearExperiment):
        axis, axis_name = np.array(one.normal_stress), "normal stress [Pa]"
    kind: str = one.kind  # pyright: ignore[reportAttributeAccessIssue]
    errors = np.full(len(readings), one.noise)  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(one, ScoopExperiment):
        own = SCOOP_ERROR * (predict(one, given)[0] - given["density"] * one.volume) \
            if one.model_error is None else one.model_error
        # common to all n masses, so that their mean keeps all of it: n x its variance in each of them
        errors = np.hypot(errors, np.sqrt(len(readings)) * own)
    return Trial(name, kind, readings, errors, simulate, True, one.held_out, axis, axis_name,
                 {"tilt": "deg", "shear": "Pa"}.get(kind, "kg"))


def make_candidates(measurements: Measurements) -> list[Trial]:
    """Make trials of the experiments that could be made: their readings are zero."""
    made = []
    for name, one in measurements.candidates.items():
        if isinstance(one, HeapExperiment):
            half = 1.25 * rim(one.radius, one.height / one.radius)
            axis = np.arange(-half, half, one.scale or 0.002)  # pixels [m] of a depth camera at 1 m
            distances = np.hypot(*np.meshgrid(axis, axis)).ravel()
            rings = data.sort_rings(distances, 0.0 * distances, one.radius / data.RINGS)
            made.append(_heap_trial(measurements, name, one, rings))
        elif isinstance(one, PourExperiment):
            times = np.linspace(0.0, 1.3 * one.end_angle / one.tilt_speed, data.CURVE_POINTS)
            made.append(_pour_trial(measurements, name, one, data.Curve(times, np.zeros(data.CURVE_POINTS))))
    return made


def _heap_trial(measurements: Measurements, name: str, heap: HeapExperiment, rings: data.Rings) -> Trial:
    model = HEAP_ERROR * heap.radius / heap.cells if heap.model_error is None else heap.model_error

    def simulate(numbers: Numbers, seed: int) -> np.ndarray:
        friction = numbers[WALL_FRICTION] if heap.floor_friction is None else heap.floor_friction
        heights = simulate_heap(heap, measurements.changed_card(numbers), friction, rings.distances, seed)
        return rings.mean(heights)

    return Trial(name, "heap", rings.heights, np.sqrt(heap.noise**2 / rings.counts + model**2), simulate, False,
                 heap.held_out, rings.radii, "distance from the axis [m]", "m")


def _pour_trial(measurements: Measurements, name: str, pour: PourExperiment, curve: data.Curve) -> Trial:
    in_box = measurements.card.density.value * pour.length * pour.width * pour.fill_height
    model = POUR_ERROR * in_box if pour.model_error is None else pour.model_error

    def simulate(numbers: Numbers, seed: int) -> np.ndarray:
        friction = numbers[WALL_FRICTION] if pour.wall_friction is None else pour.wall_friction
        return simulate_pour(pour, measurements.changed_card(numbers), friction, curve.times, seed)

    return Trial(name, "pour", curve.masses, np.full(len(curve.masses), np.hypot(pour.noise, model)), simulate, False,
                 pour.held_out, curve.times, "time [s]", "kg")


def shear_strength(normal_stress: float, friction_angle_deg: float, cohesion: float) -> float:
    """Return the shear stress [Pa] in steady simple shear at a normal stress [Pa]; cohesion [Pa]."""
    if friction_angle_deg <= 0.0:
        return 0.0
    return shear_ratio(friction_angle_deg) * (normal_stress + cohesion / math.tan(math.radians(friction_angle_deg)))


def sliding_angle(depth: float, density: float, friction_angle_deg: float, cohesion: float) -> float:
    """Return the angle [deg] at which a layer [m] on a rough tray fails along its base: 90 where it never does.
    Balance of an infinite slope: rho g d sin(a) = m (rho g d cos(a) + c / tan(phi))."""
    ratio = shear_ratio(friction_angle_deg)
    held = shear_strength(0.0, friction_angle_deg, cohesion) / (density * G * depth)
    sine = held / math.hypot(1.0, ratio)  # sin(a) - m cos(a) = held, with m = tan(b): sin(a - b) = held cos(b)
    return 90.0 if sine >= 1.0 else min(math.degrees(math.asin(sine) + math.atan(ratio)), 90.0)


def predict(experiment: Experiment, numbers: dict[str, float]) -> list[float]:
    """Return what an experiment would read, in SI units and degrees, with the numbers of a material by name."""
    density = numbers["density"]
    if isinstance(experiment, CupExperiment):
        return [density * experiment.volume] * len(experiment.masses)
    if isinstance(experiment, TiltExperiment) and experiment.slides_on == "wall":
        return [math.degrees(math.atan(numbers[WALL_FRICTION]))] * len(experiment.angles)
    phi, cohesion = numbers.get("friction_angle_deg", 0.0), numbers.get("cohesion", 0.0)
    if isinstance(experiment, TiltExperiment):
        return [sliding_angle(experiment.depth, density, phi, cohesion)] * len(experiment.angles)
    if isinstance(experiment, ShearExperiment):
        return [shear_strength(stress, phi, cohesion) for stress in experiment.normal_stress]
    if isinstance(experiment, ScoopExperiment):
        # assumed: the heap on the rim is a cone whose flank slides as a layer of a third of the rim's radius would, at
        # most at 75 deg
        angle = sliding_angle(experiment.rim_radius / 3.0, density, phi, cohesion)
        cone = math.pi * experiment.rim_radius**3 * math.tan(math.radians(min(angle, 75.0))) / 3.0
        return [density * (experiment.volume + cone)] * len(experiment.masses)
    raise TypeError(f"{type(experiment).__name__} has no closed form")
