"""The viewer's server serves its own page alone, and takes only values that its controls can have."""

import math
import socket
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
import viser
from browser_window import wait_until
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from robosim.viewer.server import start_server, stop_server


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


def ask(server: viser.ViserServer, request: bytes) -> bytes:
    """Return the first line of the answer to a request."""
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=10) as client:
        client.sendall(request + b"\r\n\r\n")
        return client.makefile("rb").readline().strip()


def test_pages_of_other_sites_are_refused(server: viser.ViserServer) -> None:
    port = server.get_port()
    for host, origin in (("127.0.0.1", "https://other.org"), ("127.0.0.1", "null"), ("127.0.0.1", "http://127.0.0.1:1"),
                         ("127.0.0.1", f"http://localhost:{port}"), ("other.org", f"http://other.org:{port}"),
                         ("127.0.0.1.other.org", None)):
        with pytest.raises(InvalidStatus, match="403"):
            open_page(server, origin, host)
    assert ask(server, b"GET / HTTP/1.1\r\nHost: other.org") == b"HTTP/1.1 403 Forbidden"
    for host in ("127.0.0.1", "localhost"):
        open_page(server, f"http://{host}:{port}", host).close()


@pytest.mark.parametrize("request_line", [b"GET http://[ HTTP/1.1", b"GET /" + b"a" * 5000 + b" HTTP/1.1",
                                          b"GET http://[", b"POST / HTTP/1.1", b"\x00\xff", b"GET /\xff HTTP/1.1"])
def test_a_malformed_request_is_answered(server: viser.ViserServer, request_line: bytes,
                                         capfd: pytest.CaptureFixture[str]) -> None:
    assert ask(server, request_line + b"\r\nHost: 127.0.0.1") == b"HTTP/1.1 400 Bad Request"
    assert not capfd.readouterr().err


def test_values_that_a_control_cannot_have_are_ignored(server: viser.ViserServer, capfd: pytest.CaptureFixture[str]
                                                       ) -> None:
    gui = server.gui
    speed, box = gui.add_dropdown("speed", ("1x", "2x"), initial_value="1x"), gui.add_checkbox("play", False)
    slider = gui.add_slider("time [s]", min=0.0, max=2.0, step=0.1, initial_value=1.0)
    handle = server.scene.add_transform_controls("/waypoint", position=(1.0, 2.0, 3.0))

    def update(control: Any, **values: Any) -> dict[str, Any]:
        return {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": values}

    def move(*position: Any) -> dict[str, Any]:
        return {"type": "TransformControlsUpdateMessage", "name": "/waypoint", "wxyz": [1, 0, 0, 0],
                "position": position, "owner": ""}

    wrong = [update(speed, value="evil"), update(speed, value=["1x"]), update(speed, options=["evil"]),
             update(box, value="no"), update(slider, value=math.nan), update(slider, value=2.1),
             update(slider, value=True), update(slider, max=9.0), move(math.nan, 0, 0), move(0, 0), move("evil", 0, 0),
             move(1e300, 0, 0), {"type": "ShareUrlRequest"}, {"type": []}, [1], "evil"]
    with open_page(server) as page:
        for message in [*wrong, update(slider, value=0.5)]:
            page.send(msgspec.msgpack.encode(message))
        page.send("text")
        page.send(b"\xc1")
        page.send(msgspec.msgpack.encode(move(4, 5, 6)))
        wait_until(lambda: tuple(handle.position) == (4.0, 5.0, 6.0), 10.0)
    assert (speed.value, speed.options, box.value, slider.value, slider.max) == ("1x", ("1x", "2x"), False, 0.5, 2.0)
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == len(wrong) + 2 and lines[0].endswith("speed 'evil'; accepted: 1x, 2x")
    assert all(line.startswith("robosim view: ignored from a page: ") for line in lines)
