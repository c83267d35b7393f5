"""The viewer's server, which this machine alone reaches; others forward its port over SSH."""

import contextlib
import io

import viser

from robosim.recordings.ports import LOCAL, PORT, check_port, free_port


def open_server(port: int = PORT) -> tuple[viser.ViserServer, str]:
    """Serve an empty scene; return the server and its address. Raises ConfigError for a port that is in use."""
    check_port(port)
    return start_server(port), f"http://{LOCAL}:{port}"


def start_server(port: int | None = None) -> viser.ViserServer:
    """Start viser at a port, without the box that it prints; None: at any free port."""
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=LOCAL, port=free_port() if port is None else port, verbose=False)


def stop_server(server: viser.ViserServer) -> None:
    """Stop viser, without the line that it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
