"""What the viewer's server takes from its clients: requests of its own page, and values that its controls can have."""

import contextlib
import re
import sys
from typing import Any
from urllib.parse import parse_qs

import msgspec
import viser
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from mpm.files import quote

OWN_HOST, TARGET = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?"), re.compile(r"/[!-~]{0,1000}")
"""Names under which a browser here, or behind an SSH tunnel, asks for the page; what it asks for."""
POSE = {"position": (3, -1e6, 1e6), "wxyz": (4, -1e6, 1e6)}
MESSAGES = {"GuiUpdateMessage": {}, "TransformControlsDragStartMessage": {}, "TransformControlsDragEndMessage": {},
            "TransformControlsUpdateMessage": POSE,
            "ViewerCameraMessage": {**POSE, "look_at": (3, -1e6, 1e6), "up_direction": (3, -1e6, 1e6),
                                    "fov": (1, 1e-3, 3.1), "near": (1, 0.0, 1e6), "far": (1, 0.0, 1e6),
                                    "image_height": (1, 1.0, 1e6), "image_width": (1, 1.0, 1e6)}}
"""Types of messages that are taken -> their numbers: how many, the smallest and the largest."""


class ViewerConnection(ServerConnection):
    """A connection that refuses what other pages ask for, and leaves out messages that would stop the viewer."""

    gui: viser.GuiApi | None = None
    asked: float | None = None
    """Time [s] of the last bookmark that was opened, until it is shown; the class has it: all pages have one clock."""

    async def handshake(self, process_request: Any = None, *rest: Any) -> None:
        """Perform the opening handshake; 400, 403 or 404 for requests that are no page's."""
        await super().handshake(lambda own, request: self._refuse(request) or process_request(own, request), *rest)

    def _refuse(self, request: Request) -> Response | None:
        """Return the answer to a request that is not of the viewer's own page."""
        if TARGET.fullmatch(request.path) is None:
            return self.respond(400, "malformed request target\n")
        # another site has its own Origin; a name of its own with this machine's address (DNS rebinding) is the Host
        host, origin = ("".join(request.headers.get_all(name)) for name in ("Host", "Origin"))
        if OWN_HOST.fullmatch(host) is None or origin not in ("", f"http://{host}"):
            return self.respond(403, "only the viewer's own page is served, at http://127.0.0.1 or http://localhost\n")
        if max(map(len, request.path.partition("?")[0].split("/"))) > 255:  # no file has such a name; viser looks it up
            return self.respond(404, "not found\n")
        if (time := read_time(request.path)) is not None:
            type(self).asked = time
        return None

    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next message that fits."""
        while True:
            message: Any = await super().recv(decode)
            if not (fault := find_fault(message, self.gui)):
                return message
            print(f"robosim view: ignored from a page: {fault}", file=sys.stderr, flush=True)


def read_time(target: str) -> float | None:
    """Return the time [s] of a bookmark, by what a page asks for (`/?time=7.6`); None without one."""
    with contextlib.suppress(KeyError, ValueError):
        return float(parse_qs(target.partition("?")[2])["time"][0])
    return None


def find_fault(raw: Any, gui: viser.GuiApi | None) -> str:
    """Return what is wrong with a message, and what would be accepted; "" for one that fits."""
    try:
        message = msgspec.msgpack.decode(raw)
        for name, (count, low, high) in MESSAGES[message["type"]].items():
            numbers = message[name] if count > 1 else [message[name]]
            if len(numbers) != count or not all(low <= number <= high for number in numbers):
                return f"{name} {quote(message[name])}; accepted: {count} of {low:g} to {high:g}"
        hash(message.get("name"))  # by which viser looks a handle up
        if message["type"] != "GuiUpdateMessage":
            return ""
        value, = [message["updates"][key] for key in {"value", *message["updates"]}]
        handle: Any = gui and gui._gui_input_handle_from_uuid.get(message["uuid"])
    except (msgspec.DecodeError, TypeError, KeyError, ValueError, RecursionError):
        return f"no message of the viewer's page: {quote(raw)}"
    if not handle:  # it was removed just now
        return ""
    if isinstance(handle.value, bool):
        is_valid, accepted = isinstance(value, bool), "true or false"
    elif isinstance(handle.value, str):
        is_valid, accepted = value in handle.options, ", ".join(handle.options)
    else:
        is_valid = type(value) in (int, float) and handle.min <= value <= handle.max
        accepted = f"{handle.min:g} to {handle.max:g}"
    return "" if is_valid else f"{handle.label} {quote(value)}; accepted: {accepted}"
