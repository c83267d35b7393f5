"""Experiments with a closed form: tilted tray, shear cell, cup, heaped scoop.

In steady simple shear the cone carries tau = m (sigma + c / tan phi), with m = 2 sqrt(3) sin(phi) / (3 - sin(phi)): the
law's own ratio, which the verification cases `slope` and `element_path` measure, and not tan(phi). c / tan(phi) is the
tension of the cone's apex. So a number that is fitted with these forms makes a simulation do what the sample did.
"""

import math

from robosim.studies.calibration.measurements import (
    WALL_FRICTION,
    CupExperiment,
    Experiment,
    ScoopExperiment,
    ShearExperiment,
    TiltExperiment,
)

G = 9.81


def shear_ratio(friction_angle_deg: float) -> float:
    """Return the ratio of shear stress to pressure in steady simple shear of a cone of triaxial compression [-]."""
    sine = math.sin(math.radians(friction_angle_deg))
    return 2.0 * math.sqrt(3.0) * sine / (3.0 - sine)


def friction_angle(ratio: float) -> float:
    """Return the friction angle [deg] whose cone carries a ratio of shear stress to pressure; inverse of the above."""
    return math.degrees(math.asin(3.0 * ratio / (2.0 * math.sqrt(3.0) + ratio)))


def shear_strength(normal_stress: float, friction_angle_deg: float, cohesion: float) -> float:
    """Return the shear stress [Pa] in steady simple shear at a normal stress [Pa]; cohesion [Pa]."""
    if friction_angle_deg <= 0.0:
        return 0.0
    return shear_ratio(friction_angle_deg) * (normal_stress + cohesion / math.tan(math.radians(friction_angle_deg)))


def sliding_angle(depth: float, density: float, friction_angle_deg: float, cohesion: float) -> float:
    """Return the angle [deg] at which a layer [m] on a rough tray fails along its base: 90 where it never does.

    Balance of an infinite slope: rho g d sin(a) = m (rho g d cos(a) + c / tan(phi)).
    """
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
