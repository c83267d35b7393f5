"""What came of a rehearsal: figures, curves, pictures, and the motion for the real robot."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.output_folder import OutputFolder
from robosim.config.motion import JointTrajectoryConfig
from robosim.config.table import validate
from robosim.episode.film import FilmFailed
from robosim.recordings.reader import FILE as RECORDING
from robosim.rehearsal.dosing_driver import DoseSample
from robosim.rehearsal.readings import align_signs
from robosim.rehearsal.run import RehearsalRun
from robosim.rendering.video import read_frames
from robosim.reports.curves import FILE as PAGE_CURVES
from robosim.robot.ros_trajectory import make_gripper_commands, make_joint_trajectory
from robosim.scene.grasp import CLOSING_SHARE

TRAJECTORY = "joint_trajectory.yaml"
"""The motion for the real robot: written after a rehearsal that held all bounds."""
MISSED_TRAJECTORY = "joint_trajectory_MISSED_BOUNDS.yaml"
"""The same of one that did not, if it is asked for."""
PARTS = ("", "_gripper", "_approach", "_approach_gripper")
"""Files of a motion: the end of their names."""
RESULTS = ("report.json", "index.html", "rehearsal.mp4", "frames.png", "poster.png", "trajectory.csv",
           *(f"{Path(name).stem}{part}.yaml" for name in (TRAJECTORY, MISSED_TRAJECTORY) for part in PARTS), RECORDING,
           PAGE_CURVES, "last_good_state.npz")
"""Files of an earlier run, which are removed first; report.json, which is written last, before all others."""
CURVES = ("time", "q", "qd", "qdd", "torque", "sensed_torque", "external_torque", "commanded", "reached", "wrist",
          "tool_force")
"""Fields of `robosim.rehearsal.readings.Step` that are curves."""


class Result:
    """Of a run of a rehearsal, whose files are in a folder."""

    def __init__(self, run: RehearsalRun, figures: dict[str, Any], missed: list[str], folder: Path) -> None:
        self.config = run.config
        self.figures = figures
        """Name -> value; a name ends in the unit, if there is one."""
        self.missed = missed
        """A line for each figure outside its bound; empty where all were held."""
        self.folder = folder
        """Of the files that `robosim rehearse` writes."""
        self.failure: FilmFailed | None = None
        """Why there is no film, if one was asked for and could not be made."""
        self.curves = {name: run.readings.stack_steps(name) for name in CURVES}
        """Name -> values of every step (n,) or (n, k); see `robosim.rehearsal.readings.Step`."""
        align_signs(self.curves["commanded"], self.curves["reached"])
        self.curves |= {"grain_time": run.readings.stack_grains("time"),
                        "mass_in_tool": run.readings.stack_grains("mass_in_tool")}
        if run.dosing is not None:  # see `robosim.rehearsal.dosing_driver.DoseSample`
            self.curves |= {f"dose_{name}": run.dosing.stack(name) for name in DoseSample._fields}
        self.positions = run.solver.positions()
        """Of the grains at the end [m] (m, 3)."""
        self.is_repeatable = run.replay is None and not run.driver.is_own and self.config.dose is None
        """Whether a real arm can repeat the motion: it is the planned one, and no balance controls it."""
        self._motion, self._assembly = run.plan.motion, run.plan.arm.assembly
        self._approach = None if run.plan.approach is None else run.plan.approach.motion
        self._closes, self._opens = run.grasp_begin, run.held_until

    def frames(self, count: int = 9) -> list[np.ndarray]:
        """Return pictures (height, width, 3) of the film, evenly spaced in time; none where no film was made."""
        film = self.folder / "rehearsal.mp4"
        return read_frames(film, count) if film.is_file() else []

    def save(self, folder: str | Path) -> Path:
        """Copy all files into a folder, and return it; files of an earlier run there are replaced."""
        with OutputFolder(Path(folder)) as out:
            out.clear(RESULTS)
            for file in sorted(self.folder.iterdir()):
                if file.name in (*RESULTS, "config.yaml", "material.yaml"):
                    out.write(file.name, lambda path, file=file: shutil.copyfile(file, path))
            return out.path

    def export_ros2(self, path: str | Path, *, joint_prefix: str = "", joint_names: dict[str, str] | None = None,
                    frame_id: str = "", force: bool = False) -> Path:
        """Write the motion as ROS 2's trajectory_msgs/JointTrajectory, and the hand's commands as NAME_gripper.yaml.

        NAME_approach.yaml and NAME_approach_gripper.yaml are those of the way from home to the motion's first point: a
        tool that is not picked up is put into the hand at home.
        joint_prefix, joint_names, frame_id: of the controller, as `joint_trajectory` of the file, which holds where
        none is given. Raises ConfigError where a bound was missed, unless force: then the file's name says so; and for
        a rehearsal with a dose, which a balance controls."""
        path = Path(path)
        if self.config.dose is not None:
            raise ConfigError(f"{path}: not written, for the balance controls the dose, and no motion repeats it; "
                              f"accepted: a rehearsal without `dose`")
        if self.figures["trajectory"] == "driver":
            raise ConfigError(f"{path}: not written, for driver {self.figures['driver']} moved the arm, not the plan; "
                              f"accepted: a run without a driver")
        if self.missed and not force:
            raise ConfigError(f"{path}: not written, for bounds were missed: {'; '.join(self.missed)}")
        if self.missed and "MISSED_BOUNDS" not in path.stem:
            path = path.with_name(f"{path.stem}_MISSED_BOUNDS{path.suffix}")
        given = {"joint_prefix": joint_prefix, "joint_names": joint_names or {}, "frame_id": frame_id}
        names = validate(given, Path("export_ros2"), JointTrajectoryConfig) if any(given.values()) else \
            self.config.joint_trajectory
        rest, files = self.config.grasp_time, dict[str, dict]()
        closing = [(0.0, False), (CLOSING_SHARE * rest, True)]
        motions = {"": (self._motion, rest, closing)}
        if self.config.pick is not None:
            picking = [(0.0, False), *((self._closes + time, is_closed) for time, is_closed in closing)]
            if np.isfinite(self._opens):
                picking += [(self._opens, True), (self._opens + CLOSING_SHARE * rest, False)]
            motions = {"": (self._motion, rest, picking), "_approach": (self._approach, 0.0, [(0.0, False)])}
        elif self._approach is not None:
            motions = {"": (self._motion, rest, [(0.0, True)]), "_approach": (self._approach, rest, closing)}
        for part, (motion, start, changes) in motions.items():
            if motion is None:
                continue
            files[part] = make_joint_trajectory(motion, self._assembly.robot.joints, names, start=start)
            if self._assembly.hand is not None:
                files[f"{part}_gripper"] = make_gripper_commands(self._assembly.hand, changes)
        with OutputFolder(path.parent, is_shared=True) as out:
            for part, content in files.items():
                out.write_yaml(f"{path.stem}{part}{path.suffix}", content)
        return path
