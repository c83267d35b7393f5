"""The viewer's server: what it takes from its clients, and pages of their own."""

import math
import socket
import urllib.request
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
import viser
from browser_window import wait_until
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from robosim.base.errors import ConfigError
from robosim.recordings.live import free_port
from robosim.viewer.server import open_server, start_server, stop_server


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = start_server()
    yield server
    stop_server(server)


def open_page(server: viser.ViserServer, origin: str | None = None, host: str = "127.0.0.1") -> Any:
    """Connect as a page does."""
    port, protocol = server.get_port(), Subprotocol(f"viser-v{viser.__version__}")
    return connect(f"ws://{host}:{port}", sock=socket.create_connection(("127.0.0.1", port)), subprotocols=[protocol],
                   origin=None if origin is None else Origin(origin))


def test_pages_of_other_sites_are_refused(server: viser.ViserServer) -> None:
    port = server.get_port()
    for host, origin in (("127.0.0.1", "https://other.org"), ("127.0.0.1", "null"), ("127.0.0.1", "http://127.0.0.1:1"),
                         ("127.0.0.1", f"http://localhost:{port}"), ("other.org", f"http://other.org:{port}"),
                         ("127.0.0.1.other.org", None)):
        with pytest.raises(InvalidStatus, match="403"):
            open_page(server, origin, host)
    for host in ("127.0.0.1", "localhost"):
        open_page(server, f"http://{host}:{port}", host).close()


def test_wrong_requests_are_answered(server: viser.ViserServer, capfd: pytest.CaptureFixture[str]) -> None:
    for target, host, status in (("http://[", "localhost", b"400"), ("/" + "a" * 5000, "localhost", b"400"),
                                 ("/" + "a" * 998, "localhost", b"404"), ("/", "other.org", b"403"),
                                 ("/?" + "a" * 900, "localhost", b"200")):
        with socket.create_connection(("127.0.0.1", server.get_port()), timeout=10) as client:
            client.sendall(f"GET {target} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
            assert client.makefile("rb").readline().split()[1] == status and not capfd.readouterr().err


def test_values_that_a_control_cannot_have_are_ignored(server: viser.ViserServer, capfd: pytest.CaptureFixture[str]
                                                       ) -> None:
    gui = server.gui
    speed, box = gui.add_dropdown("speed", ("1x", "2x"), initial_value="1x"), gui.add_checkbox("play", False)
    slider = gui.add_slider("time [s]", min=0.0, max=2.0, step=0.1, initial_value=1.0)
    handle = server.scene.add_transform_controls("/waypoint")
    control, move = {"type": "GuiUpdateMessage"}, {"type": "TransformControlsUpdateMessage", "name": "/waypoint",
                                                   "wxyz": [1, 0, 0, 0], "owner": ""}
    wrong = [{**control, "uuid": one._impl.uuid, "updates": updates} for one, updates in (
        (speed, {"value": "evil"}), (speed, {"value": ["1x"]}), (speed, {"options": ["evil"]}), (box, {"value": "no"}),
        (slider, {"value": math.nan}), (slider, {"value": 2.1}), (slider, {"value": 1.0, "max": 9.0}))]
    wrong += [{**move, "position": position} for position in ((math.nan, 0, 0), (0, 0), ("evil", 0, 0), (1e300, 0, 0))]
    with open_page(server) as page:
        for message in (*wrong, {"type": "ShareUrlRequest"}, [1], {**move, "position": (4, 5, 6)}):
            page.send(msgspec.msgpack.encode(message))
        wait_until(lambda: tuple(handle.position) == (4.0, 5.0, 6.0), 10.0)
    assert (speed.value, speed.options, box.value, slider.value, slider.max) == ("1x", ("1x", "2x"), False, 1.0, 2.0)
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == len(wrong) + 2 and lines[0].endswith("speed 'evil'; accepted: 1x, 2x")
    assert all(line.startswith("robosim view: ignored from a page: ") for line in lines)


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
