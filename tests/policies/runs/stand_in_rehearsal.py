"""A stand-in for the physics of a rehearsal: an arm that waves and grains that rest. All files are written as usual."""

import time
from types import SimpleNamespace

import mujoco
import numpy as np

import mpm

SCENE = '<mujoco><worldbody><body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>'
NAMES = tuple(f"A{k}" for k in range(1, 8))
STEPS, STEP = 60, 2e-3
"""Host steps of a rehearsal, and the real time [s] that one takes."""


def wave(at):
    """Return the arm's state at a time [s]."""
    from robosim.robot.timing import JointState

    phase = 5.0 * at + np.arange(7.0)
    return JointState(np.sin(phase), 5.0 * np.cos(phase), -25.0 * np.sin(phase))


class PointRun:
    """A rehearsal whose readings are known in closed form."""

    def __init__(self, plan, seed=0, replay=None, errors=None):
        from robosim.rehearsal.readings import Readings

        self.replay, self.grasp_begin, self.held_from = replay, 0.0, 0.0
        self.held_until = np.inf
        self.config = config = plan.config
        self.plan, self.seed, self.readings, self.wall_time = plan, seed, Readings(NAMES), 0.0
        self.duration = self.expected_duration = STEPS * config.host_dt
        self.time, self.stage = 0.0, None
        self.material = SimpleNamespace(model_dump=lambda mode: {})
        self.model = mujoco.MjModel.from_xml_string(SCENE)
        self.data = mujoco.MjData(self.model)
        self.plugin = SimpleNamespace(wrench=lambda body: mpm.Wrench(np.zeros(3), np.zeros(3)))
        self.solver, self.timings = SimpleNamespace(positions=lambda: np.zeros((5, 3)), sleep=True), {}

    def waypoint_time(self, name):
        return self.plan.path.times[name]

    def planned_passages(self):
        return sorted((time, name) for name, time in self.plan.path.times.items())

    def run(self, after_step):
        from robosim.rehearsal.readings import EnergySample, GrainSample, Step

        for k in range(STEPS):
            time.sleep(STEP)
            self.time = self.data.time = (k + 1) * self.config.host_dt
            state, pose = wave(self.time), np.array([np.sin(self.time), 0.0, 0.3, 1.0, 0.0, 0.0, 0.0])
            self.readings.steps.append(Step(
                time=self.time, q=state.q, qd=state.qd, qdd=state.qdd, torque=state.q, demanded_torque=state.q,
                sensed_torque=state.q, external_torque=state.q, commanded=pose, reached=pose, wrist=state.q[:6],
                residual=np.full(6, 1e-12), exchanged=np.ones(2), tool_work=0.1, tool_force=state.q[:3]))
            self.readings.grains.append(GrainSample(self.time, 0.01 * k, 0, 1.0))
            self.readings.energies.append(EnergySample(self.time, 1.0, 2.0, 3.0))
            after_step()
        self.wall_time = STEPS * STEP


def plan_motion(config):
    """Return a plan of the waving arm."""
    time.sleep(50 * STEP)
    return SimpleNamespace(config=config, motion=SimpleNamespace(state=wave, duration=STEPS * config.host_dt),
                           arm=SimpleNamespace(joints=NAMES, torque_limits=np.full(7, 300.0), assembly=SimpleNamespace(
                               hand=None, robot=SimpleNamespace(joints=NAMES))),
                           path=SimpleNamespace(times={"dig": 0.01, "pour": 0.04}), approach=None, no_approach="")


def compute_figures(run):
    """Return figures that depend on every step."""
    from robosim.rehearsal.metrics import BOUNDS

    mass = run.readings.stack_grains("mass_in_tool")
    return dict.fromkeys(BOUNDS, 0.0) | {
        "scooped_mass_kg": float(mass.max()), "delivered_fraction": float(len(run.readings.steps) / STEPS),
            "spilled_fraction": 0.0, "wrist_payload_relative_error": 0.0, "realtime_factor": 1.0,
            "momentum_residual": float(run.readings.stack_steps("residual").max())}


def make_recorder(run, path):
    """Record the body of the stand-in's scene."""
    from robosim.recordings.scene_recorder import SceneRecorder
    from robosim.rehearsal.recorder import CURVES

    return SceneRecorder(path, run.model, run.data, None, kind="rehearsal", title="a stand-in", curves=CURVES)


def read_curves(run):
    """Return readings of curves that are as long as the real ones."""
    from robosim.rehearsal.recorder import CURVES

    return lambda grains: [run.time] * len(CURVES)


def make_film():
    """Return a film of noise, with the files of the real one."""
    from robosim.rehearsal import film
    from robosim.rendering.video import Mp4Writer

    class NoiseFilm(film.Film):
        def __init__(self, out):
            self._out = out.path
            self._renderer = SimpleNamespace(close=lambda: None)
            self._writer = Mp4Writer(out.path / "rehearsal.mp4", fps=film.FRAME_RATE)
            self._plan = SimpleNamespace(poster=None, passages=[], config=SimpleNamespace(material="salt"))
            self._poster, self._passages = None, []
            self._loads = []

        def begin(self, run, camera, colour, rate, height, poster):
            self._run = run

        def add_due_frame(self):
            self.add(film.FilmState(self._run.time, np.zeros(7), np.zeros((5, 3))))

        def _count_load(self, state):
            return 5.0

        def draw(self, state):
            return np.random.default_rng(0).integers(0, 255, (96, 96, 3), np.uint8)

    return NoiseFilm


def install_rehearsal(session):
    """Put the stand-ins in the place of a rehearsal's physics."""
    session.plan_motion, session.RehearsalRun, session.FilmProcess = plan_motion, PointRun, make_film()
    session.make_recorder, session.RunReadings = make_recorder, read_curves
    session.compute_figures, session.find_missed = compute_figures, lambda figures, config: []
