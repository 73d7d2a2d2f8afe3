"""HTTP routes: the files of the page, maps, recorded rounds, and the upload of a map."""

import asyncio
import mimetypes
import re
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from pacman_env import __version__
from pacman_env.web.game_interface import Game, Refused
from pacman_env.web.log import Log
from pacman_env.web.sessions import VIEW_ONLY, Sessions

STATIC = Path(__file__).with_name("static")
MOST_UPLOAD = 8 << 20
UPLOAD_S = 20.0
#: Lets a browser request all modules at once, instead of one level of imports after another.
_MODULES = ", ".join(
    f"<static/{path.name}>; rel=modulepreload" for path in sorted(STATIC.glob("*.js")) if path.name != "support.js"
)
_PIECE = 1 << 16  # bytes of a round that are sent at once, so that a slow reader blocks no more

for _suffix, _kind in {"js": "javascript", "css": "css", "html": "html"}.items():  # the system's list may be wrong
    mimetypes.add_type(f"text/{_kind}", f".{_suffix}")
mimetypes.add_type("image/svg+xml", ".svg")


class Upload(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    yaml: str
    image: bytes  # base64 in the message


def map_name(name: str) -> str:
    return re.sub(r"[^a-z0-9_-]+", "-", name.lower())[:40].strip("-_") or "map"


class Routes:
    def __init__(self, game: Game, sessions: Sessions, log: Log):
        self._game, self._sessions, self._log = game, sessions, log
        self._files = StaticFiles(directory=STATIC)
        self._upload = asyncio.Semaphore(1)  # bounds the memory of all uploads

    def all(self) -> list[BaseRoute]:
        return [
            Route("/", self._page),
            Mount("/static", self._files),
            Route("/health", self._health),
            Route("/map", self._add_map, methods=["POST"]),
            Route("/map/{revision:int}.png", self._picture),
            Route("/story/{number:int}.json", self._story),
        ]

    async def _page(self, request: Request) -> Response:
        page = await self._files.get_response("index.html", request.scope)
        page.headers["link"] = _MODULES
        return page

    async def _health(self, request: Request) -> Response:
        return JSONResponse({"ok": True, "version": __version__})

    async def _picture(self, request: Request) -> Response:
        picture = self._sessions.audience.pictures.get(request.path_params["revision"])
        if not picture:
            return PlainTextResponse("no such map\n", 404)
        return Response(picture, media_type="image/png", headers={"cache-control": "no-store"})

    async def _story(self, request: Request) -> Response:
        story = await self._sessions.in_thread(self._game.story, request.path_params["number"])
        if story is None:
            return PlainTextResponse("no such round\n", 404)
        pieces = (story[at : at + _PIECE] for at in range(0, len(story), _PIECE))
        return StreamingResponse(pieces, media_type="application/json", headers={"cache-control": "no-store"})

    async def _add_map(self, request: Request) -> Response:
        if request.scope["access"] != "operator":
            return _map_answer(403, VIEW_ONLY)
        if self._upload.locked():
            return _map_answer(429, "another map is being uploaded: try again in a moment")
        async with self._upload:
            try:
                async with asyncio.timeout(UPLOAD_S):
                    body = await _body(request)
                if body is None:
                    return _map_answer(413, f"a map of more than {MOST_UPLOAD >> 20} MB")
                added = await self._sessions.in_thread(self._add, body)
            except (TimeoutError, ClientDisconnect):
                return _map_answer(408, "the upload took too long")
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                return _map_answer(400, f"no map: {error}")
            except Refused as refused:  # well-formed: the page shows the reason, and the browser logs no error
                return _map_answer(200, str(refused))
            except Exception as error:
                self._log.error("a map", error)
                return _map_answer(500, "internal error")
            return _map_answer(200, added["words"], added["map"])

    def _add(self, body: bytes) -> dict[str, Any]:
        upload = msgspec.json.decode(body, type=Upload)
        return self._game.add_map(map_name(upload.name), upload.yaml, upload.image)


async def _body(request: Request) -> bytes | None:
    """Return the body, or None if it is too large; the whole body is read, so that the page receives the answer."""
    body, size = bytearray(), 0
    async for part in request.stream():
        size += len(part)
        if size <= MOST_UPLOAD:
            body += part
        elif size > 8 * MOST_UPLOAD:
            break
    return bytes(body) if size <= MOST_UPLOAD else None


def _map_answer(status: int, words: str, name: str | None = None) -> Response:
    headers = {"connection": "close"} if status in (408, 413) else {}  # the rest of the body is not read
    return JSONResponse({"ok": name is not None, "words": words, "map": name}, status, headers)
