"""Who may open the viewer's page."""

import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from http.cookiejar import CookieJar

import pytest

from robosim.base.errors import ConfigError
from robosim.viewer.server import COOKIE, choose_token, open_server, stop_server

TOKEN = "a-token-of-a-test"


@pytest.fixture
def port() -> int:
    """Return a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def gated(port: int) -> Iterator[str]:
    """Serve at all addresses of this machine, behind a token."""
    server, _ = open_server("0.0.0.0", port, TOKEN)
    yield f"http://127.0.0.1:{port}/"
    stop_server(server)


def test_this_machine_needs_no_token(port: int) -> None:
    assert choose_token("127.0.0.1", allows_others=False) == ""
    server, address = open_server("127.0.0.1", port)
    assert address == f"http://127.0.0.1:{port}"
    with urllib.request.urlopen(address, timeout=10) as answer:
        assert answer.status == 200
    stop_server(server)


def test_others_need_the_users_word() -> None:
    with pytest.raises(ConfigError, match=r"--host 0.0.0.0: others could see .* --allow-others; .*ssh -L"):
        choose_token("0.0.0.0", allows_others=False)
    tokens = {choose_token("0.0.0.0", allows_others=True) for _ in range(10)}
    assert len(tokens) == 10 and all(len(token) >= 20 for token in tokens)


@pytest.mark.parametrize("query", ["", "?token=", "?token=another", f"?other={TOKEN}", f"?token={TOKEN}x"])
def test_without_the_token_nothing_is_served(query: str, gated: str) -> None:
    with pytest.raises(urllib.error.HTTPError, match="403") as refused:
        urllib.request.urlopen(gated + query, timeout=10)
    refused.value.close()


def test_the_token_opens_the_page_and_a_cookie_keeps_it_open(gated: str) -> None:
    jar = CookieJar()
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(jar))
    with opener.open(f"{gated}?token={TOKEN}", timeout=10) as answer:
        assert answer.status == 200 and b"<html" in answer.read().lower()
    assert {cookie.name: cookie.value for cookie in jar} == {COOKIE: TOKEN}
    with opener.open(gated, timeout=10) as answer:
        assert answer.status == 200
    request = urllib.request.Request(gated, headers={"Cookie": f"{COOKIE}=another"})
    with pytest.raises(urllib.error.HTTPError, match="403") as refused:
        urllib.request.urlopen(request, timeout=10)
    refused.value.close()


def test_a_port_in_use_is_refused_with_a_free_one(port: int) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", port))
        other.listen()
        with pytest.raises(ConfigError, match=rf"--port {port}: Address already in use; accepted: .*free port, such "
                                              r"as [0-9]+"):
            open_server("127.0.0.1", port)


def test_a_host_that_is_not_this_machine_is_refused(port: int) -> None:
    with pytest.raises(ConfigError, match=r"--host 203.0.113.7 .*accepted: an address of this machine"):
        open_server("203.0.113.7", port, TOKEN)
