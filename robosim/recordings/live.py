"""A page of a scene that a program steps itself; and ports of this machine that pages are served at."""

import contextlib
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import mujoco

import mpm
from robosim.base.errors import ConfigError
from robosim.recordings.reader import FILE
from robosim.recordings.scene_recorder import FRAME_RATE, SceneRecorder

LOCAL = "127.0.0.1"
"""Address that this machine alone reaches."""
PORT = 8080
"""At which a page is served unless one asks for another."""


def check_port(port: int) -> None:
    """Raise ConfigError where a port cannot be listened at."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOCAL, port))
        except OSError as error:
            raise ConfigError(f"--port {port}: {error.strerror}; accepted: a free port, such as {free_port()}"
                              ) from None


def free_port() -> int:
    """Return a port that is free now."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return int(probe.getsockname()[1])


class LiveView(contextlib.AbstractContextManager["LiveView"]):
    """Records a scene while a program steps it, and serves its page from a process of its own.
    Call `update` after every step: it records a frame when one is due. The page follows, and plays what was recorded.
    tool: body whose path is drawn, and at which the force of `wrench` is. out: file that the recording is kept in,
    which `robosim view` plays; None: a temporary one. Raises ConfigError for a port that is in use."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, solver: mpm.Solver | None, *, tool: str = "",
                 wrench: Callable[[], mpm.Wrench] | None = None, port: int = PORT, frame_rate: float = FRAME_RATE,
                 out: Path | None = None) -> None:
        check_port(port)
        self._data, self._wrench, self._files = data, wrench, contextlib.ExitStack()
        path = out or Path(self._files.enter_context(tempfile.TemporaryDirectory(prefix="robosim-view-"))) / FILE
        self.recorder = SceneRecorder(path, model, data, solver, kind="scene", title="a scene", frame_rate=frame_rate,
                                      tool=tool)
        self.update()
        self._process = subprocess.Popen([sys.executable, "-m", "robosim", "view", f"{path}.part", "--port", str(port)],
                                         stdout=subprocess.DEVNULL)
        self.address = f"http://{LOCAL}:{port}"

    def update(self) -> bool:
        """Record the present state if a frame is due; return whether it was."""
        return self.recorder.add(self._data, wrench=None if self._wrench is None else self._wrench())

    def close(self) -> None:
        """Finish the recording and end the page. May be called twice."""
        self.recorder.close()
        self._process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(10.0)
        self._files.close()

    def __exit__(self, *_: object) -> None:
        self.close()
