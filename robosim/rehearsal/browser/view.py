"""`robosim view`: from what is asked for to a page that is served."""

import contextlib
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError, RobosimError
from robosim.config.settings import Setting
from robosim.recordings.reader import Recording, find_recordings
from robosim.reports.curves import FILE as CURVES
from robosim.reports.curves import Chart, read_charts
from robosim.tasks.task import is_task
from robosim.viewer.playback import Playback
from robosim.viewer.server import open_server, stop_server

WAIT = 0.2
"""Time [s] between two looks for the recording of a rehearsal that prepares."""


class RunFailed(RobosimError, RuntimeError):
    """The rehearsal that was to be shown ended before its first frame; its own message says why."""


def view(what: str, *, port: int, plan: bool = False, material: str | None = None, out: Path | None = None,
         settings: list[Setting] | None = None) -> int:
    """Serve a page of a run's folder, a recording or a rehearsal until interrupted.
    plan: the planned motion of a rehearsal. material, out, settings: of a rehearsal that is begun, whose results go
    into the folder `out`; None: a temporary one. Raises ConfigError for what cannot be shown or served, RunFailed."""
    with contextlib.ExitStack() as stack:
        if plan:
            from robosim.rehearsal.browser.plan_editor import PlanEditor

            show = PlanEditor(what, settings or []).run
        else:
            is_recorded = Path(what).is_dir() or what.endswith((".rec", ".rec.part"))
            path = find_recordings(Path(what))[0] if is_recorded else \
                stack.enter_context(begin_run(what, material, out, settings or []))
            recording = stack.enter_context(Recording(path))
            is_whole = recording.is_finished and recording.header.kind == "rehearsal"
            charts = read_page_charts(path.parent) if is_whole else []
            def show(server: Any) -> None:
                Playback(server, recording, charts).run()
        server, address = open_server(port)
        stack.callback(stop_server, server)
        print(f"{address}   (Ctrl-C ends it)", flush=True)
        show(server)
    return 0


def read_page_charts(folder: Path) -> list[Chart]:
    """Return the charts of the page of a run, none where it has no file of them; one that is damaged is said."""
    try:
        return read_charts(folder / CURVES)
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        print(f"{error}; shown are the curves of the recording", file=sys.stderr)
        return []


@contextlib.contextmanager
def begin_run(name: str, material: str | None, out: Path | None, settings: list[Setting]) -> Iterator[Path]:
    """Begin a rehearsal, or an episode of a sub-task's script, in a process of its own; give its recording at once.
    The process is ended with the viewer. Raises RunFailed, and ConfigError for a folder with a recording, which would
    be lost or shown."""
    kept = [path for end in ("*.rec", "*.rec.part") for path in out.glob(end)] if out else []
    if kept:
        raise ConfigError(f"--out {out}: holds {kept[0].name} of another run; accepted: another folder, or `robosim "
                          f"view {out}` to show that run")
    with tempfile.TemporaryDirectory(prefix="robosim-view-") as temporary:
        folder = out or Path(temporary)
        words = ["evaluate", name, "--episodes", "1"] if is_task(name) else ["rehearse", name]
        command = [sys.executable, "-m", "robosim", *words, "--no-video", "--out", str(folder)]
        command += [word for s in settings for word in ("--set", s.text)]
        command += ["--material", material] if material else []
        process = subprocess.Popen(command)
        try:
            yield wait_for_recording(folder, process)
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10.0)


def wait_for_recording(folder: Path, process: "subprocess.Popen[bytes]") -> Path:
    """Wait until a run has begun its recording; raises RunFailed where it ends before."""
    while True:
        has_ended = process.poll() is not None
        with contextlib.suppress(ConfigError):  # there is none yet, or its header is still being written
            path = find_recordings(folder)[0]
            Recording(path).close()
            return path
        if has_ended:
            raise RunFailed(f"nothing to show: the rehearsal ended with status {process.returncode}")
        clock.sleep(WAIT)
