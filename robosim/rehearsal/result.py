"""What came of a rehearsal: figures, curves, pictures, and the motion for the real robot."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from robosim.config.output import OutputFolder
from robosim.config.robot import JointTrajectoryConfig
from robosim.errors import ConfigError
from robosim.rehearsal.film_process import FilmFailed
from robosim.rehearsal.readings import align_signs
from robosim.rehearsal.run import CLOSING_SHARE, RehearsalRun
from robosim.rendering.video import count_frames, read_frames
from robosim.robot.ros_trajectory import make_gripper_commands, make_joint_trajectory

TRAJECTORY = "joint_trajectory.yaml"
"""The motion for the real robot: written after a rehearsal that held all bounds."""
MISSED_TRAJECTORY = "joint_trajectory_MISSED_BOUNDS.yaml"
"""The same of one that did not, if it is asked for."""
GRIPPER_COMMANDS = "gripper_commands.yaml"
"""When the hand closes; beside the motion."""
CURVES = ("time", "q", "qd", "qdd", "torque", "sensed_torque", "external_torque", "commanded", "reached", "wrist",
          "tool_force")
"""Fields of `robosim.rehearsal.readings.Step` that are curves."""


class Result:
    """Of a run of a rehearsal, whose files are in a folder."""

    def __init__(self, run: RehearsalRun, figures: dict[str, Any], missed: list[str], folder: Path,
                 failure: FilmFailed | None = None) -> None:
        self.config = run.config
        self.figures = figures
        """Name -> value; a name ends in the unit, if there is one."""
        self.missed = missed
        """A line for each figure outside its bound; empty where all were held."""
        self.folder = folder
        """Of the files that `robosim rehearse` writes."""
        self.failure = failure
        """Why there is no film, if one was asked for and could not be made."""
        self.curves = {name: run.readings.stack_steps(name) for name in CURVES}
        """Name -> values of every step (n,) or (n, k); see `robosim.rehearsal.readings.Step`."""
        align_signs(self.curves["commanded"], self.curves["reached"])
        self.curves |= {"grain_time": run.readings.stack_grains("time"),
                        "mass_in_tool": run.readings.stack_grains("mass_in_tool")}
        self.positions = run.solver.positions()
        """Of the grains at the end [m] (m, 3)."""
        self._motion, self._assembly = run.plan.motion, run.plan.arm.assembly

    def frames(self, count: int = 9) -> list[np.ndarray]:
        """Return pictures (height, width, 3) of the film, evenly spaced in time; none where no film was made."""
        film = self.folder / "rehearsal.mp4"
        if not film.is_file():
            return []
        return read_frames(film, np.unique(np.linspace(0, count_frames(film) - 1, count).round().astype(int)).tolist())

    def save(self, folder: str | Path) -> Path:
        """Copy all files into a folder, and return it; files of an earlier run there are replaced."""
        with OutputFolder(Path(folder)) as out:
            for file in sorted(self.folder.iterdir()):
                if file.is_file():
                    out.write(file.name, lambda path, file=file: shutil.copyfile(file, path))
            return out.path

    def export_ros2(self, path: str | Path, *, joint_prefix: str = "", joint_names: dict[str, str] | None = None,
                    frame_id: str = "", force: bool = False) -> Path:
        """Write the motion as ROS 2's trajectory_msgs/JointTrajectory, and the hand's commands beside it.

        joint_prefix, joint_names, frame_id: of the controller, as `joint_trajectory` of the file, which holds where
        none is given. Raises ConfigError where a bound was missed, unless force: then the file's name says so.
        """
        path = Path(path)
        if self.missed and not force:
            raise ConfigError(f"{path}: not written, for bounds were missed: {'; '.join(self.missed)}")
        if self.missed and "MISSED_BOUNDS" not in path.stem:
            path = path.with_name(f"{path.stem}_MISSED_BOUNDS{path.suffix}")
        given = {"joint_prefix": joint_prefix, "joint_names": joint_names or {}, "frame_id": frame_id}
        names = JointTrajectoryConfig.model_validate(given) if any(given.values()) else self.config.joint_trajectory
        message = make_joint_trajectory(self._motion, self._assembly.robot.joints, names, start=self.config.grasp_time)
        out = OutputFolder(path.parent)
        out.write_yaml(path.name, message)
        if self._assembly.hand is not None:
            closed = CLOSING_SHARE * self.config.grasp_time
            out.write_yaml(GRIPPER_COMMANDS, make_gripper_commands(self._assembly.hand, closed))
        return path
