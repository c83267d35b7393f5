"""Rehearsals from Python: plan, run, and what came of it."""

import shutil
import tempfile
import weakref
from pathlib import Path
from typing import Any

from robosim.config.rehearsal import RehearsalConfig, load_rehearsal
from robosim.config.table import validate
from robosim.episode.film import FilmStyle
from robosim.planning.plan import Plan, plan_motion
from robosim.recordings.scene_recorder import FRAME_RATE
from robosim.rehearsal.result import Result
from robosim.rehearsal.session import RunOptions, check_config, simulate


class Rehearsal:
    """A whole-arm rehearsal.

    config: name of one of configs/rehearsals, path of a .yaml file, or a configuration. changes: keys of the file with
    other values. Raises ConfigError, UnknownName before any work.
    """

    def __init__(self, config: str | Path | RehearsalConfig, **changes: Any) -> None:
        if isinstance(config, RehearsalConfig):
            config = validate(config.model_dump() | changes, Path("the configuration"), RehearsalConfig)
        else:
            config = load_rehearsal(str(config), changes)
        self.config = check_config(config)

    def plan(self) -> Plan:
        """Plan the motion: tool path, postures, timing, clearances.

        Raises ConfigError, UnreachableWaypoint for what cannot be performed, by the waypoint's name.
        """
        return plan_motion(self.config)

    def run(self, *, out: str | Path | None = None, camera: str | None = None, seed: int = 0,
            model_errors: int | None = None, driver: Any = None, frame_rate: float = FRAME_RATE,
            **film: Any) -> Result:
        """Simulate the planned motion with the grains.

        out: folder of the files; None: a temporary one, until `Result.save`. camera: of the film, None for none; film:
        height, colour, poster of it. seed: of the grains' initial positions. model_errors: seed of errors by which the
        robot differs from its model. driver: a function or object of one's own that commands the joints in the plan's
        place, see `robosim.cell.drivers.OwnDriver`; with a dose a controller of doses. frame_rate: of recording
        and film [1/s]. Raises as `plan`, and mpm.SimulationDiverged, RobotDiverged, DriverFault; status.json then says
        why.
        """
        folder = Path(tempfile.mkdtemp(prefix="rehearsal_") if out is None else out)
        result = simulate(self.config, folder, RunOptions(
            None if camera is None else FilmStyle(camera, **film), frame_rate, seed, model_errors=model_errors,
            driver=driver))
        if out is None:
            weakref.finalize(result, shutil.rmtree, folder, ignore_errors=True)
        return result
