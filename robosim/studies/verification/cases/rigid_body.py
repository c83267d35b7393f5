"""A rigid body of MuJoCo, coupled to the field of a case."""

from collections.abc import Sequence

import mujoco

import mpm
from robosim.coupling.plugin import Coupling, GranularPlugin

G = 9.81
"""[m/s^2]"""
ONE_BODY = """
<mujoco>
  <option timestep="{host_step}" integrator="implicitfast" gravity="{gravity}"/>
  <worldbody><body name="body" pos="{position}" {body}>{joint}<geom {geom}/></body></worldbody>
</mujoco>
"""


def one_body(geom: str, position: Sequence[float], *, host_step: float, joint: str = "<freejoint/>",
             gravity: Sequence[float] = (0.0, 0.0, -G), body: str = "") -> str:
    """Return the MJCF of a world with one body, "body".
    geom, body: attributes of its geometry, and of the body itself; position [m]; host_step [s]."""
    numbers = {"position": position, "gravity": gravity}
    return ONE_BODY.format(geom=geom, joint=joint, host_step=host_step, body=body,
                           **{name: " ".join(str(float(x)) for x in vector) for name, vector in numbers.items()})


def couple(scene: str, solver: mpm.Solver, coupling: Coupling = "mobility",
           bodies: dict[str, int | None] | None = None) -> GranularPlugin:
    """Couple bodies of a scene in MJCF to a solver, "body" where none are named."""
    model = mujoco.MjModel.from_xml_string(scene)
    return GranularPlugin(model, mujoco.MjData(model), solver, bodies=bodies or {"body": None}, coupling=coupling)


def damp(plugin: GranularPlugin, factor: float) -> None:
    """Multiply the velocities of particles and bodies by a factor."""
    state = plugin.solver.state()
    state["v"] *= factor
    plugin.solver.load(state)
    plugin.data.qvel *= factor
