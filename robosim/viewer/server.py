"""The port that the viewer is served on, and who may see it."""

import asyncio
import contextlib
import io
import secrets
import socket
import threading
from urllib.parse import parse_qs, urlsplit

import viser

from robosim.base.errors import ConfigError
from robosim.recordings.ports import LOCAL, PORT, check_port, free_port

COOKIE = "robosim_token"
MOST_HEADER = 16_384
"""Bytes of a request's header."""
REFUSAL = (b"HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
           b"Open the address that robosim printed, with its token.\n")


def open_server(host: str = LOCAL[0], port: int = PORT, token: str = "") -> tuple[viser.ViserServer, str]:
    """Serve an empty scene; returns the server and its address.

    token: needed in the address for a host that other machines reach; see `choose_token`. Raises ConfigError for a port
    that is in use.
    """
    check_port(host, port)
    is_local = host in LOCAL
    inner = port if is_local else free_port()
    server = start_server(inner)
    if is_local:
        return server, f"http://{host}:{port}"
    Gate(host, port, inner, token).start()
    return server, f"http://{host if host != '0.0.0.0' else socket.gethostname()}:{port}/?token={token}"


def start_server(port: int | None = None) -> viser.ViserServer:
    """Start viser at a port of this machine alone, without the box that it prints; None: at any free port."""
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=LOCAL[0], port=free_port() if port is None else port, verbose=False)


def stop_server(server: viser.ViserServer) -> None:
    """Stop viser, without the line that it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def choose_token(host: str, allows_others: bool) -> str:
    """Return the token of an address; empty for this machine alone.

    Raises ConfigError for a host that other machines reach unless the user allows others.
    """
    if host in LOCAL:
        return ""
    if not allows_others:
        raise ConfigError(f"--host {host}: others could see and control the viewer; accepted: {LOCAL[0]}, or "
                          f"--host {host} --allow-others; over SSH use: ssh -L {PORT}:{LOCAL[0]}:{PORT} this-machine")
    return secrets.token_urlsafe(16)


class Gate:
    """Passes connections on to a port of this machine if they have the token, in the address or in a cookie."""

    def __init__(self, host: str, port: int, inner: int, token: str) -> None:
        self._host, self._port, self._inner, self._token = host, port, inner, token

    def start(self) -> None:
        """Listen in a thread of its own, as long as the process lives."""
        ready = threading.Event()
        threading.Thread(target=lambda: asyncio.run(self._serve(ready)), daemon=True, name="viewer gate").start()
        ready.wait(10.0)

    async def _serve(self, ready: threading.Event) -> None:
        server = await asyncio.start_server(self._answer, self._host, self._port)
        ready.set()
        async with server:
            await server.serve_forever()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            header = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 10.0)
        except (asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError, ConnectionError):
            writer.close()
            return
        try:
            if len(header) <= MOST_HEADER and self._is_in_address(header):
                writer.write(f"HTTP/1.1 302 Found\r\nLocation: /\r\nSet-Cookie: {COOKIE}={self._token}; HttpOnly; "
                             f"SameSite=Strict; Path=/\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode())
            elif len(header) <= MOST_HEADER and self._has_cookie(header):
                await self._pass_on(header, reader, writer)
            else:
                writer.write(REFUSAL)
            await writer.drain()
        except ConnectionError:
            pass
        finally:
            writer.close()

    def _is_in_address(self, header: bytes) -> bool:
        words = header.split(b"\r\n", 1)[0].decode("latin-1").split(" ")
        given = parse_qs(urlsplit(words[1]).query).get("token", [""])[0] if len(words) > 1 else ""
        return bool(given) and secrets.compare_digest(given.encode(), self._token.encode())

    def _has_cookie(self, header: bytes) -> bool:
        for line in header.decode("latin-1").split("\r\n"):
            name, _, value = line.partition(":")
            if name.lower() == "cookie":
                given = [part.strip().removeprefix(f"{COOKIE}=") for part in value.split(";")
                         if part.strip().startswith(f"{COOKIE}=")]
                return any(secrets.compare_digest(one.encode(), self._token.encode()) for one in given)
        return False

    async def _pass_on(self, header: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        inner_reader, inner_writer = await asyncio.open_connection(LOCAL[0], self._inner)
        inner_writer.write(header)
        await asyncio.gather(_pump(reader, inner_writer), _pump(inner_reader, writer))


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Copy until the end of one side."""
    try:
        while chunk := await reader.read(65_536):
            writer.write(chunk)
            await writer.drain()
    except ConnectionError:
        pass
    finally:
        writer.close()
