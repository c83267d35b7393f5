"""Ports of this machine that pages are served at."""

import socket

from robosim.base.errors import ConfigError

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
