"""The film of a rehearsal, drawn in a process of its own from states that are handed over."""

import contextlib
import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path
from typing import BinaryIO

import numpy as np

from robosim.base.errors import RobosimError
from robosim.base.output_folder import OutputFolder
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.film import FRAME_RATE, Film, FilmPlan, FilmState, plan_film, read_state
from robosim.rehearsal.run import RehearsalRun
from robosim.rendering.renderer import RenderingUnavailable

WAITING_BYTES = 200_000_000
"""States that wait to be drawn take at most so much memory; then the simulation waits for the film."""
PIPE_BYTES = 1 << 20
"""Room of the pipe, the most that Linux gives: a few states."""
NO_RENDERING = 3
"""Exit status of a process that cannot draw on this machine."""
HEADER = struct.Struct("<ddqq?")
"""What comes before a state: its time and delay [s], the numbers of its joint positions and of its grains, and whether
it says which of these sleep."""
END = HEADER.pack(0.0, 0.0, -1, -1, False)
"""Instead of a state's header: there are no more."""
PATIENCE = 2.0
"""Seconds of drawing that are left from which their number is printed."""


class FilmFailed(RobosimError, RuntimeError):
    """The film could not be written; the message says why. What was simulated is complete."""


class FilmProcess:
    """Draws a run's film beside the simulation: it has one core less, and waits for no picture.

    The process loads what it needs while the run is prepared. Where pictures cannot be drawn on this machine, one line
    on stderr says so, and the run goes on. States go through a pipe as it has room; no thread sends them, which would
    have to wait for the simulation's launches.
    """

    def __init__(self, out: OutputFolder) -> None:
        self._next_frame_time, self._is_told, self._run = 0.0, False, None
        self._marks_sleepers, self._rate = False, FRAME_RATE
        self._log = tempfile.TemporaryFile("w+")  # noqa: SIM115  (read when the process has ended)
        # software renderers take every core they see
        environment = {"LP_NUM_THREADS": str(max((os.cpu_count() or 1) - 1, 1))} | os.environ
        self._process = subprocess.Popen([sys.executable, "-m", "robosim.rehearsal.film_process", str(out.path)],
                                         stdin=subprocess.PIPE, stdout=self._log, stderr=self._log, env=environment,
                                         bufsize=0)
        stdin = self._process.stdin
        assert stdin is not None
        self._stdin, self._pipe = stdin, stdin.fileno()
        with contextlib.suppress(OSError, AttributeError):  # Linux, from Python 3.10 on
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(self._pipe, False)
        self._waiting: deque[memoryview] = deque()
        """What is still to be sent."""

    def begin(self, run: RehearsalRun, camera: str, colour: str = "material", rate: int = FRAME_RATE,
              height: int = 720, poster: float | None = None) -> None:
        """Tell the process what it will be sent; raises UnknownName for camera and colour."""
        plan = plan_film(run, camera, colour, rate, height, poster)
        self._run, self._marks_sleepers, self._rate = run, plan.marks_sleepers, rate
        self._hand_over(pack_plan(plan))

    def add_due_frame(self) -> None:
        """Hand over the present state if a frame is due, and send what waits."""
        assert self._run is not None
        if self._run.time + 1e-9 >= self._next_frame_time:
            self._next_frame_time += 1.0 / self._rate
            self._hand_over(pack_state(read_state(self._run, self._marks_sleepers)))
            if sum(map(len, self._waiting)) > WAITING_BYTES:
                self._send_all()
        self._send()

    def close(self) -> None:
        """Finish film and sheet, with the frames so far where the run stopped early; raises FilmFailed.

        May be called twice.
        """
        if self._log.closed:
            return
        with self._log:
            if self._run is None:  # nothing was begun
                self._process.kill()
            else:
                if len(self._waiting) > PATIENCE * self._rate:
                    print(f"drawing the last {len(self._waiting)} frames ...", file=sys.stderr)
                self._hand_over(END)
                self._send_all()
            with contextlib.suppress(OSError):
                self._stdin.close()
            status = self._process.wait()
            if status == NO_RENDERING:
                self._tell_that_there_is_none()
            elif status != 0 and self._run is not None:
                raise FilmFailed(f"no film: {self._last_line() or f'its process ended with status {status}'}")

    def _hand_over(self, content: bytes) -> None:
        if self._process.poll() is None:
            self._waiting.append(memoryview(content))
        else:
            self._tell_that_there_is_none()

    def _send(self) -> None:
        """Send as much as the pipe has room for; what a process does not take any more is dropped."""
        try:
            while self._waiting:
                sent = os.write(self._pipe, self._waiting[0])
                self._waiting[0] = self._waiting[0][sent:]
                if not self._waiting[0]:
                    self._waiting.popleft()
        except BlockingIOError:
            pass
        except OSError:
            self._waiting.clear()

    def _send_all(self) -> None:
        """Send all, however long it takes the process to draw."""
        os.set_blocking(self._pipe, True)
        self._send()
        os.set_blocking(self._pipe, False)

    def _last_line(self) -> str:
        self._log.seek(0)
        return (self._log.read().strip().splitlines() or [""])[-1]

    def _tell_that_there_is_none(self) -> None:
        """Say once, where the process cannot draw, why there will be no film."""
        if self._process.returncode == NO_RENDERING and not self._is_told:
            self._is_told = True
            print(f"no video: {self._last_line()}", file=sys.stderr)


def pack_plan(plan: FilmPlan) -> bytes:
    """Return a plan as a line of JSON."""
    values = plan._asdict() | {"config": plan.config.model_dump(mode="json")}
    return json.dumps(values).encode() + b"\n"


def unpack_plan(line: bytes) -> FilmPlan:
    """Return the plan of a line."""
    values = json.loads(line)
    passages = {key: [(float(time), str(text)) for time, text in values[key]]
                for key in ("passages", "passages_after_dose")}
    return FilmPlan(**values | passages | {"config": RehearsalConfig.model_validate(values["config"]),
                                           "colour": tuple(values["colour"])})


def pack_state(state: FilmState) -> bytes:
    """Return a state as a header and its numbers."""
    qpos, positions = np.asarray(state.qpos, "<f8"), np.asarray(state.positions, "<f4")
    asleep = b"" if state.asleep is None else np.asarray(state.asleep, bool).tobytes()
    header = HEADER.pack(state.time, state.delay, len(qpos), len(positions), bool(asleep))
    return header + qpos.tobytes() + positions.tobytes() + asleep


def read_packed_state(stream: BinaryIO) -> FilmState | None:
    """Return the next state, or None where there are no more; raises EOFError where the stream ends before."""
    time, delay, joints, grains, marks = HEADER.unpack(_read(stream, HEADER.size))
    if joints < 0:
        return None
    qpos = np.frombuffer(_read(stream, 8 * joints), "<f8")
    positions = np.frombuffer(_read(stream, 12 * grains), "<f4").reshape(-1, 3)
    asleep = np.frombuffer(_read(stream, grains), bool) if marks else None
    return FilmState(time, qpos, positions, asleep, delay)


def _read(stream: BinaryIO, size: int) -> bytes:
    content = stream.read(size)
    if len(content) < size:
        raise EOFError
    return content


def main() -> int:
    """Draw the plan and the states that come on stdin, until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the simulation, which ends the stream
    with contextlib.suppress(OSError):
        os.nice(5)  # where cores are few, the simulation comes first
    stream = sys.stdin.buffer
    line = stream.readline()
    if not line.endswith(b"\n"):
        return 1
    try:
        film = Film(unpack_plan(line), Path(sys.argv[1]))
    except RenderingUnavailable as error:
        print(error, file=sys.stderr)
        return NO_RENDERING
    try:
        while (state := read_packed_state(stream)) is not None:
            film.add(state)
    except EOFError:  # who sends was killed; the film ends there
        return 1
    finally:
        film.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
