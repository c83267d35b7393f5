"""The viewer's server, which this machine alone reaches (others forward its port over SSH), and pages of their own."""

import contextlib
import io
import logging
from functools import partial
from unittest import mock
from weakref import WeakKeyDictionary

import viser
import websockets.asyncio.server as websocket_server

from robosim.recordings.live import LOCAL, PORT, check_port, free_port
from robosim.recordings.reader import Recording
from robosim.viewer.charts import History
from robosim.viewer.connection import ViewerConnection
from robosim.viewer.scene_view import SceneView, aim_first_camera

KINDS: WeakKeyDictionary[viser.ViserServer, type[ViewerConnection]] = WeakKeyDictionary()
"""Server -> class of its connections."""


def open_server(port: int = PORT) -> tuple[viser.ViserServer, str]:
    """Serve an empty scene; return the server and its address. Raises ConfigError for a port that is in use."""
    check_port(port)
    server = start_server(port)
    server.gui.main_panel.dock_right()  # beside the scene, not over it
    return server, f"http://{LOCAL}:{port}"


def start_server(port: int | None = None) -> viser.ViserServer:
    """Start viser at a port, for its own page alone, without the box that it prints; None: at any free port."""
    kind: type[ViewerConnection] = type("Connection", (ViewerConnection,), {})
    logger = logging.getLogger("robosim.viewer")
    logger.setLevel(logging.CRITICAL)  # a handshake that fails is answered, without a traceback here
    serve = partial(websocket_server.serve, create_connection=kind, logger=logger)
    with contextlib.redirect_stdout(io.StringIO()), mock.patch.object(websocket_server, "serve", wraps=serve) as used:
        server = viser.ViserServer(host=LOCAL, port=free_port() if port is None else port, verbose=False)
    if not used.called:  # viser has no parameter for it
        raise RuntimeError(f"viser {viser.__version__} starts its server otherwise; its clients cannot be checked")
    kind.gui, KINDS[server] = server.gui, kind
    return server


def take_asked_time(server: viser.ViserServer) -> float | None:
    """Return the time [s] of a bookmark that was opened since the last call; None without one."""
    kind = KINDS[server]
    asked, kind.asked = kind.asked, None
    return asked


def stop_server(server: viser.ViserServer) -> None:
    """Stop viser, without the line that it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def embed_html(recording: Recording) -> str:
    """Return an HTML document that plays a recording in 3-D: orbit with the mouse, scrub at the bottom."""
    server = start_server()
    try:
        history = History(recording)
        history.refresh()
        view = SceneView(server, recording, history)
        aim_first_camera(server, recording.header.cameras, "close")
        view.overlays.set_visible("path", True)
        every = max(1, -(-len(recording) // 600))  # so that the page has 600 frames at most
        view.show(0)
        serializer = server.get_scene_serializer()
        for k in range(0, len(recording), every):
            view.show(k)
            serializer.insert_sleep(every / recording.header.frame_rate)
        return serializer.as_html()
    finally:
        stop_server(server)
