"""Policies of environments: scripts, dosing controllers, recorded motions, learned networks; and suites of starts.

Imports: base, config, dosing, envs, randomization, senses, shapes, tasks, mpm."""

from pathlib import Path

from robosim.base.errors import UnknownName
from robosim.dosing import CONTROLLERS

KNOWING = "knowing"
"""The script with its waypoints displaced as the target is: what a controller that knows the place reaches."""
PULSED = "pi"
"""The dosing controller whose pulses a learned policy changes."""
POLICIES = ("zero", "random", "scripted", KNOWING, "recorded", *CONTROLLERS)
"""Policies by name, the controllers for dosing tasks alone; any other is the path of a .npz file."""
NETWORKS = {"network": "networks", "student": "students"}
"""Bundled policies that observe, of the sub-tasks that have one -> their folder. A network sees the grains as no robot
does, a student what a robot senses."""
SUITES = ("nominal", "wide", "materials", "hard")
"""Starts and materials that policies are scored from, see `robosim.studies.policies.suites`."""


def check_policy(name: str) -> None:
    """Raise UnknownName unless a policy is a name or a file."""
    if name not in POLICIES and not Path(name).is_file():
        raise UnknownName("policy", name, POLICIES, "or the path of a .npz file with an array `actions` or a network")
