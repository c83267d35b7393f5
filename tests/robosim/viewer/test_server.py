"""The port of the viewer's page."""

import socket
import urllib.request

import pytest

from robosim.base.errors import ConfigError
from robosim.recordings.live import free_port
from robosim.viewer.server import open_server, stop_server


def test_the_page_is_served_to_this_machine() -> None:
    port = free_port()
    server, address = open_server(port)
    assert address == f"http://127.0.0.1:{port}"
    with urllib.request.urlopen(address, timeout=10) as answer:
        assert answer.status == 200
    stop_server(server)


def test_a_port_in_use_is_refused_with_a_free_one() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"--port {port}: Address already in use; accepted: .*free port, such "
                                              r"as [0-9]+"):
            open_server(port)
