"""A rehearsal from its file to its results: check everything, run, write everything."""

import contextlib
import shutil
import sys
import tempfile
import time as clock
import weakref
from pathlib import Path
from typing import Any, NamedTuple

import mpm
from robosim.base.errors import ConfigError, DriverFault, RobotDiverged
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.config.materials import load_material
from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.config.table import validate
from robosim.conversion.joint_log import JointLog
from robosim.episode import AUTO
from robosim.episode.cameras import find_camera
from robosim.episode.film import FilmStyle, try_film
from robosim.planning.lip_motion import make_lip_motion
from robosim.planning.plan import Plan, plan_motion
from robosim.planning.recorded_motions import place_target
from robosim.recordings.reader import FILE as RECORDING
from robosim.recordings.scene_recorder import FRAME_RATE, SceneRecorder
from robosim.rehearsal.comparison import OPPOSITE
from robosim.rehearsal.dosing_driver import check_target, make_dose_controller
from robosim.rehearsal.metrics import compute_figures, find_missed
from robosim.rehearsal.page import make_charts, make_page
from robosim.rehearsal.recorded_motion import RecordedMotion, read_log
from robosim.rehearsal.recorder import RunReadings, finish_recording, make_recorder
from robosim.rehearsal.result import MISSED_TRAJECTORY, RESULTS, TRAJECTORY, Result
from robosim.rehearsal.run import RehearsalRun, make_cell
from robosim.reports.curves import FILE as CURVES
from robosim.reports.curves import pack_charts
from robosim.robot.assembly import check_payload
from robosim.robot.model import Arm
from robosim.robot.model_errors import draw_model_errors
from robosim.robot.ros_trajectory import name_joints
from robosim.scene.build import assemble_rehearsal, compile_rehearsal
from robosim.scene.field import check_field, choose_region, filled_volume

PRINTED = {
    "scooped_mass_kg": ("scooped", "{:.4f} kg"), "delivered_fraction": ("delivered", "{:.1%}"),
    "spilled_fraction": ("spilled", "{:.1%}"),
    "wrist_payload_relative_error": ("error of the load weighed at the wrist", "{:.2%}"),
    "momentum_residual": ("momentum unaccounted for, of what was exchanged", "{:.1e}"),
    "realtime_factor": ("simulated seconds per second", "{:.3f}"),
    "dose_target_kg": ("target of the dose", "{:.5f} kg"), "dose_kg": ("dosed", "{:.5f} kg"),
    "dose_error_kg": ("error of the dose", "{:+.5f} kg"), "dose_grain_mass_kg": ("mass of a grain", "{:.5f} kg"),
    "dosing_time_s": ("time of the dose", "{:.2f} s"),
    "recorded_clock_offset_s": ("recorded time at which the motion starts", "{:.3f} s"),
    "recorded_joint_difference_max_deg": ("recorded from planned joint angles, at most", "{:.3f} deg"),
    "recorded_tool_difference_max_m": ("recorded from planned place of the tool, at most", "{:.4f} m"),
    "recorded_force_difference_rms_N": ("recorded from simulated wrist force, rms", "{:.3f} N"),
    "recorded_torque_difference_rms_Nm": ("recorded from simulated wrist torque, rms", "{:.4f} N m"),
}
"""Figure of the report -> its name and form on the console; those of a dose or a recording only where there is one."""


class RunOptions(NamedTuple):
    """How a rehearsal is run, which its configuration does not say."""

    film: FilmStyle | None = None
    """How it is drawn, after the run; None: there is none."""
    frame_rate: float = FRAME_RATE
    """Of recording and film [1/s]."""
    seed: int = 0
    """Of the grains' initial positions."""
    recorded: Path | None = None
    """What the real arm recorded of the motion (see `robosim.conversion.joint_log_files`), which is played in the
    plan's place and compared with it."""
    episode: int = 0
    """Of what was recorded, where that is a LeRobot dataset."""
    is_unplanned: bool = False
    """Whether what was recorded is a motion of its own, which follows no plan."""
    model_errors: int | None = None
    """Seed of errors by which the robot differs from its model; None: it does not."""
    driver: Any = None
    """A user's own, in the plan's place, see `robosim.cell.drivers.OwnDriver`."""


AS_PLANNED = RunOptions()
"""The plan, without a film."""


class Rehearsal:
    """A whole-arm rehearsal.
    config: name of one of configs/rehearsals, path of a .yaml file, or a configuration. changes: keys of the file with
    other values. Raises ConfigError, UnknownName before any work."""

    def __init__(self, config: str | Path | RehearsalConfig, **changes: Any) -> None:
        if isinstance(config, RehearsalConfig):
            config = validate(config.model_dump() | changes, Path("the configuration"), RehearsalConfig)
        else:
            config = load_rehearsal(str(config), changes)
        self.config = check_config(config)

    def plan(self) -> Plan:
        """Plan the motion: tool path, postures, timing, clearances.
        Raises ConfigError, UnreachableWaypoint for what cannot be performed, by the waypoint's name."""
        return plan_motion(self.config)

    def run(self, *, out: str | Path | None = None, camera: str | None = None, seed: int = 0,
            model_errors: int | None = None, driver: Any = None, frame_rate: float = FRAME_RATE,
            **film: Any) -> Result:
        """Simulate the planned motion with the grains.

        out: folder of the files; None: a temporary one, until `Result.save`. camera: of the film, None for none; film:
        height, poster of it. seed: of the grains' initial positions. model_errors: seed of errors by which the
        robot differs from its model. driver: a function or object of one's own that commands the joints in the plan's
        place, see `robosim.cell.drivers.OwnDriver`; with a dose a controller of doses. frame_rate: of recording
        and film [1/s]. Raises as `plan`, and mpm.SimulationDiverged, RobotDiverged, DriverFault; status.json then says
        why."""
        folder = Path(tempfile.mkdtemp(prefix="rehearsal_") if out is None else out)
        result = simulate(self.config, folder, RunOptions(
            None if camera is None else FilmStyle(camera, **film), frame_rate, seed, model_errors=model_errors,
            driver=driver))
        if out is None:
            weakref.finalize(result, shutil.rmtree, folder, ignore_errors=True)
        return result


def rehearse(name: str, out: Path, options: RunOptions = AS_PLANNED, *, force_export: bool = False,
             **changes: Any) -> int:
    """Run a rehearsal, write its results into the folder `out`, and print the main figures.
    Returns 0, or 1 where a figure missed its bound. force_export: write the motion for the real robot also where a
    bound was missed, under a name that says so. changes: as of `check_rehearsal`."""
    config = check_rehearsal(name, **changes)
    result = simulate(config, out, options)
    if result.is_repeatable and result.missed and force_export:
        result.export_ros2(out / MISSED_TRAJECTORY, force=True)
    _print(result.figures, result.missed, out)
    if config.dose is not None:
        print(f"no {TRAJECTORY}: the dose is controlled by the balance, no motion repeats it")
    if result.is_repeatable and result.missed and not force_export:
        print(f"no {TRAJECTORY}: a bound was missed (--force-export writes {MISSED_TRAJECTORY})")
    if result.failure is not None:
        raise result.failure
    return int(bool(result.missed))


def simulate(config: RehearsalConfig, out: Path, options: RunOptions = AS_PLANNED) -> Result:
    """Run a rehearsal and write its results into the folder `out`.
    Input is checked before any work; raises ConfigError. Files are complete however the run ends. The motion for the
    real robot is written last, and only where every bound was held."""
    material, film = load_material(config.material), options.film
    if options.recorded is None and (options.episode or options.is_unplanned):
        raise ConfigError("--episode or --unplanned without --recorded; accepted: with it")
    if options.is_unplanned and config.pick is not None:
        raise ConfigError("--unplanned with a tool that is picked up; accepted: with one that the hand holds from the "
                          "start (pick: null): the recording does not say when the fingers close")
    log = None if options.recorded is None else read_log(options.recorded, config, options.episode)
    given = config
    if options.is_unplanned and config.weigh_at is not None:
        print(f"nothing is weighed: the motion does not pass the waypoint {config.weigh_at!r}", file=sys.stderr)
        config = config.model_copy(update={"weigh_at": None})
    if film is not None:
        find_camera(compile_rehearsal(config).model, film.camera or AUTO)
    with OutputFolder(out) as folder:
        folder.clear(RESULTS)
        folder.write_yaml("config.yaml", given.model_dump(mode="json"))
        folder.write_yaml("material.yaml", material.model_dump(mode="json"))
        with contextlib.ExitStack() as stack:  # each of them even where another fails, as on a full disk
            run = _prepare(config, options, log)
            stack.callback(lambda: run.time > 0.0 and folder.write("trajectory.csv", run.readings.write_csv))
            recorder = make_recorder(run, folder.path / RECORDING, options.frame_rate)
            stack.callback(finish_recording, run, recorder)
            try:
                _simulate(run, recorder)
            except (mpm.SimulationDiverged, RobotDiverged, DriverFault):
                folder.write("last_good_state.npz", run.save_last_good_state)
                finish_recording(run, recorder)
                if film is not None:  # of what was simulated
                    try_film(folder, film)
                raise
        figures = compute_figures(run)
        result = Result(run, figures, find_missed(figures, config), folder.path)
        try:
            result.failure = None if film is None else try_film(folder, film)
        finally:  # an interrupted film costs no result
            charts = make_charts(run, folder.path)
            folder.write_json(CURVES, pack_charts(charts))
            folder.write_text("index.html", make_page(run, figures, result.missed, charts, folder.path).html())
            if result.is_repeatable and not result.missed:
                result.export_ros2(folder.path / TRAJECTORY)
            folder.write_json("report.json", figures | {"missed": result.missed})
        return result


def check_rehearsal(name: str, *, material: str | None = None, grasp: str | None = None, trajectory: str | None = None,
                    motions: str | Path | None = None) -> RehearsalConfig:
    """Return the configuration of a rehearsal, with what replaces parts of it; raises ConfigError.
    trajectory: "script" or "recorded", the latter from a folder of motions, or with None the bundled ones."""
    if motions is not None and trajectory == "script":
        raise ConfigError(f"--motions {motions} with --trajectory script; accepted: with --trajectory recorded")
    chosen = {"material": material, "grasp": grasp, "trajectory": trajectory or (motions and "recorded"),
              "motions": motions and str(Path(motions).resolve())}
    return check_config(load_rehearsal(name, {key: value for key, value in chosen.items() if value}))


def check_config(config: RehearsalConfig) -> RehearsalConfig:
    """Return a configuration with its target in place; raises ConfigError for what cannot be run."""
    config = choose_region(place_target(config))
    law = load_material(config.material).make_law()
    check_field(config, law)
    check_dose(config, law.density)
    assembly = assemble_rehearsal(config)
    name_joints(assembly.robot.joints, config.joint_trajectory)  # raises for names that cannot be used
    check_payload(assembly)
    make_cell(config, Arm(assembly), assembly.robot.home)  # raises for gains that the step is too long for
    return config


def check_dose(config: RehearsalConfig, density: float) -> None:
    """Refuse a dose whose controller, lip or cup cannot be used, or that a tool which is full at the start cannot give.
    density: of the material [kg/m^3]. What a tool scoops is known when it is weighed. Raises ConfigError."""
    if config.dose is None:
        return
    make_dose_controller(config)
    make_lip_motion(config)
    if config.tool_fill_height is not None:
        check_target(config, density * filled_volume(config), "starts")


def _prepare(config: RehearsalConfig, options: RunOptions, log: JointLog | None) -> RehearsalRun:
    """Plan the motion, and make robot and grains."""
    print("planning the motion ...", file=sys.stderr)
    began = clock.perf_counter()
    plan = plan_motion(config)
    planned = clock.perf_counter()
    if plan.approach is None:
        print(f"no motion from home to the start: {plan.no_approach}", file=sys.stderr)
    replay = None if log is None else RecordedMotion(log, plan.motion, plan.arm, config, options.is_unplanned)
    print("preparing grains and robot (the first run of a scene compiles for a minute or more) ...", file=sys.stderr)
    errors = None if options.model_errors is None else draw_model_errors(options.model_errors, len(plan.arm.lower))
    run = RehearsalRun(plan, seed=options.seed, replay=replay, errors=errors, driver=options.driver)
    run.timings |= {"plan": planned - began, "prepare": clock.perf_counter() - planned}
    return run


def _simulate(run: RehearsalRun, recorder: SceneRecorder) -> None:
    """Run with a progress bar: simulated time, real-time factor, time left."""
    readings = RunReadings(run)
    run.timings["record"] = 0.0
    with Progress(total=round(run.driver.duration, 3), desc="simulated", unit="s", decimals=2) as bar:
        def after_step() -> None:
            began = clock.perf_counter()
            bar.total = max(bar.total, round(run.driver.expected_duration(run.time), 3))  # a dose makes it longer
            recorder.add(run.cell.data, readings, run.cell.plugin.wrench(run.config.tool_name))
            run.timings["record"] += clock.perf_counter() - began
            bar.update(min(run.config.host_dt, bar.total - bar.n))
            elapsed = bar.format_dict["elapsed"]
            bar.set_postfix_str(f"real-time factor {run.time / max(elapsed, 1e-9):.4f}", refresh=False)

        run.run(after_step)


def _print(figures: dict, missed: list[str], folder: Path) -> None:
    """Print the main figures, and those that missed their bounds."""
    for key, (name, form) in PRINTED.items():
        if key in figures:
            print(f"{name:46s} {'-' if figures[key] is None else form.format(figures[key])}")
    if (figures.get("recorded_force_correlation") or 0.0) < OPPOSITE:
        print("the recorded force is opposite to the simulated one: is it that of the hand on the arm? Compared is the "
              "arm's on the hand")
    for line in missed or ["none"]:
        print(f"outside its bound: {line}")
    print(f"written to {folder}")
