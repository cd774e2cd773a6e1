"""What the server answers besides the page: the viewer, its data, and files of the folder."""

import asyncio
import tempfile
import zipfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from aiohttp import web
from aiohttp.typedefs import Middleware

from morphosim.app.access import PARAMETER, Access, malformed
from morphosim.app.store import Store

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
VIEWER, STREAMS, FILES, SOCKET = "/viewer", "/streams", "/files", "/ws"


class Streams:
    """What viewers show: of each stream, the first part opens a viewer, the others are frames."""

    def __init__(self) -> None:
        self._parts: dict[str, list[bytes]] = {}

    def open(self, key: str, first: bytes) -> None:
        """Begin a stream."""
        self._parts[key] = [first]

    def add(self, key: str, frame: bytes) -> int:
        """Add a frame; return how many parts there are."""
        self._parts[key].append(frame)
        return len(self._parts[key])

    def drop(self, key: str) -> None:
        """Forget a stream."""
        self._parts.pop(key, None)

    def part(self, key: str, number: int) -> bytes | None:
        """Part of a stream; None if there is none."""
        parts = self._parts.get(key, [])
        return parts[number] if 0 <= number < len(parts) else None


def add_routes(app: web.Application, access: Access, store: Store, streams: Streams) -> None:
    """Guard all that an application answers, and add the routes of this module."""
    app.middlewares.append(_guard(access))
    app.router.add_get(VIEWER, _viewer)
    app.router.add_get(STREAMS + "/{key}/{number}", _stream_handler(streams))
    app.router.add_get(FILES + "/{name:.+}", _file_handler(store))
    app.router.add_post(FILES + "/{name}", _upload_handler(store))


def _guard(access: Access) -> Middleware:
    """Middleware that refuses what is malformed or `access` refuses, the websocket too."""

    @web.middleware
    async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
        if wrong := malformed(request.headers, request.path):
            return web.Response(status=400, text=wrong)
        cookie = f"morphosim-{request.url.port}"  # browsers share cookies between ports
        refusal = access.refusal(request.headers, request.query, request.cookies.get(cookie))
        if refusal:
            return web.Response(status=403, text=refusal)
        if request.path == SOCKET and not web.WebSocketResponse().can_prepare(request):
            return web.Response(status=400, text=f"{SOCKET} takes websockets only")
        try:
            response = await handler(request)
        except web.HTTPException as error:  # redirections too are answers
            response = error
        if not response.prepared:
            response.headers["Content-Security-Policy"] = "frame-ancestors 'self'"
            if access.token and PARAMETER in request.query:
                response.set_cookie(cookie, access.token, httponly=True, samesite="Strict")
        if isinstance(response, web.HTTPException):
            raise response
        return response

    return guard


async def _viewer(request: web.Request) -> web.Response:
    from morphosim.pictures.show import viewer_page

    return web.Response(text=viewer_page(None), content_type="text/html")


def _stream_handler(streams: Streams) -> Handler:
    async def handle(request: web.Request) -> web.StreamResponse:
        number = request.match_info["number"]
        part = streams.part(request.match_info["key"], int(number) if number.isdecimal() else -1)
        if part is None:
            raise web.HTTPNotFound
        return web.Response(body=part, content_type="application/json")

    return handle


def _file_handler(store: Store) -> Handler:
    """Send a file as it is, and a folder as one zip file."""

    async def handle(request: web.Request) -> web.StreamResponse:
        try:
            path = store.path(request.match_info["name"])
        except ValueError as error:
            return web.Response(status=403, text=str(error))
        if path.is_dir():
            return await _send_folder(request, path)
        if not path.is_file():
            raise web.HTTPNotFound
        return web.FileResponse(path, headers=_attachment(path.name))

    return handle


def _attachment(name: str) -> dict[str, str]:
    """Headers of a file to save, which no browser is to show in place of the page."""
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}


async def _send_folder(request: web.Request, folder: Path) -> web.StreamResponse:
    with tempfile.TemporaryFile() as file:
        await asyncio.to_thread(_zip, folder, file)
        response = web.StreamResponse(headers=_attachment(f"{folder.name}.zip"))
        response.content_type, response.content_length = "application/zip", file.tell()
        await response.prepare(request)
        file.seek(0)
        while chunk := file.read(1 << 20):
            await response.write(chunk)
        await response.write_eof()
    return response


def _zip(folder: Path, file: BinaryIO) -> None:
    """Pack the files of a folder, without links, which may lead out of it."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and not path.is_symlink():
                archive.write(path, path.relative_to(folder.parent))


def _upload_handler(store: Store) -> Handler:
    """Take a file from the browser; answers its name below the folder.

    The query may say `beside` which file that has come before, see `Store.receiving`.
    """

    async def handle(request: web.Request) -> web.StreamResponse:
        try:
            beside = request.query.get("beside", "")
            with store.receiving(request.match_info["name"], beside) as (name, write):
                async for chunk in request.content.iter_chunked(1 << 20):
                    write(chunk)
        except (ValueError, OSError) as error:
            return web.Response(status=400, text=str(error))
        return web.Response(text=name)

    return handle
