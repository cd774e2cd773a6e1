"""What the server answers to requests that nobody can understand, and where it listens."""

import asyncio
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("aiohttp")
from aiohttp import web
from aiohttp.test_utils import TestServer

from morphosim.app.access import Access, listening_host
from morphosim.app.routes import Streams, add_routes
from morphosim.app.store import Store

HOST = b"127.0.0.1:8000"


def answers(folder: Path, requests: list[bytes]) -> Iterator[tuple[int, bytes]]:
    """Status and text of the answers to these requests, as they are written."""

    async def ask(port: int, request: bytes) -> tuple[int, bytes]:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(request)
        answer = await reader.read()
        writer.close()
        head, _, body = answer.partition(b"\r\n\r\n")
        return int(head.split()[1]), body

    async def all_of_them() -> list[tuple[int, bytes]]:
        async def opened(request: web.Request) -> web.WebSocketResponse:
            found = web.WebSocketResponse()
            await found.prepare(request)
            return found

        app = web.Application()
        add_routes(app, Access(), Store(folder), Streams())
        app.router.add_get("/ws", opened)
        app.router.add_static("/static", folder)
        async with TestServer(app) as server:
            return [await ask(server.port, request) for request in requests]

    yield from asyncio.run(all_of_them())


def get(path: bytes = b"/viewer", host: bytes = HOST, *headers: bytes) -> bytes:
    lines = [b"GET " + path + b" HTTP/1.1", b"Host: " + host, *headers, b"Connection: close"]
    return b"\r\n".join(lines) + b"\r\n\r\n"


def test_hosts_and_origins_that_are_malformed(tmp_path: Path) -> None:
    hosts = [
        b"[::1", b"[", b"]", b"[]", b"localhost:99999", b"localhost:abc", b"localhost:-1", b"a:b:c",
        b"\xff\xfe", "localhost:²".encode(), "localhost℀".encode(), b"localhost/..", b"localhost?x",
        b"localhost#", b"a@localhost", b"local host",
    ]  # fmt: skip
    origins = [
        b"http://[::1",
        b"http://[",
        "http://℀.com".encode(),
        b"http://a:b",
        b"http://a:99999",
    ]
    requests = [get(host=host) for host in hosts]
    requests += [get(b"/viewer", HOST, b"Origin: " + origin) for origin in origins]
    for what, (status, text) in zip([*hosts, *origins], answers(tmp_path, requests), strict=True):
        assert status == 400, what
        assert text.startswith((b"Host '", b"Origin '")), what


def test_hosts_that_are_this_machine(tmp_path: Path) -> None:
    hosts = [HOST, b"localhost", b"LOCALHOST:1", b"[::1]", b"[::1]:8000", b"127.0.0.1:"]
    assert {status for status, _ in answers(tmp_path, [get(host=host) for host in hosts])} == {200}


def test_paths_that_no_file_can_have(tmp_path: Path) -> None:
    paths = [
        b"/files/" + b"a" * 300, b"/files/" + b"a/" * 3000, b"/static/" + b"a" * 300, b"/files/%00",
        b"/files/a%00b", b"/static/%00", b"/streams/%00/1", b"/ws", b"/files/" + b"%C3%A9" * 200,
    ]  # fmt: skip
    for path, (status, text) in zip(paths, answers(tmp_path, map(get, paths)), strict=True):
        assert status == 400, path
        assert text
    paths = [b"/streams/a/%C2%B2", b"/streams/a/" + b"9" * 250, b"/files/%ff", b"/files/%ED%A0%80"]
    assert {status for status, _ in answers(tmp_path, map(get, paths))} == {404}


def test_a_websocket_that_is_none(tmp_path: Path) -> None:
    upgrade = [b"Upgrade: websocket", b"Sec-WebSocket-Key: x", b"Sec-WebSocket-Version: 99"]
    ((status, text),) = answers(tmp_path, [get(b"/ws", HOST, *upgrade)])
    assert (status, text) == (400, b"/ws takes websockets only")


@pytest.mark.parametrize(
    ("host", "port", "words"),
    [
        ("", 0, ["host = ''", "127.0.0.1"]), ("  ", 0, ["host = '  '"]), ("[]", 0, ["no name"]),
        ("127.0.0.1", 99999, ["port = 99999", "65535"]), ("127.0.0.1", -1, ["port = -1"]),
        ("no.such.invalid", 0, ["'no.such.invalid'", "--host"]), ("[::1", 0, ["'[::1'"]),
        ("a..b", 0, ["'a..b'"]), ("203.0.113.1", 0, ["203.0.113.1", "--host"]),
    ],
)  # fmt: skip
def test_where_nobody_can_listen(host: str, port: int, words: list[str]) -> None:
    with pytest.raises((ValueError, OSError)) as caught:
        listening_host(host, port)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=f"host '127.0.0.1', port {port}: .*--port"):
            listening_host("127.0.0.1", port)


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("localhost", "localhost"),
        ("0", "0.0.0.0"),
        ("127.1", "127.0.0.1"),
    ],
)
def test_hosts_in_their_usual_form(host: str, expected: str) -> None:
    assert listening_host(host, 0) == expected


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
def test_hosts_of_ipv6() -> None:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("no IPv6 here")
    assert listening_host("[::1]", 0) == listening_host("::1", 0) == "::1"
