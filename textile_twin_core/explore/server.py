"""Server of the page: on the loopback address, protected by a token, with one session per tab."""

from __future__ import annotations

import asyncio
import gc
import json
import secrets
import socket
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.resources import files
from typing import Any

from aiohttp import WSMsgType, web

from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.explore.packing import Arrays
from textile_twin_core.explore.session import PageSession

LOOPBACK = "127.0.0.1"
_MOST_SESSIONS = 64
_LARGEST_MESSAGE = 4_000_000
_HEARTBEAT_S = 20.0
_COOKIE = "textile_twin_token"
_KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
_SAFE = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_NO_ENTRY = "This page needs the address with its token, as textile-twin explore printed it.\n"


class Page:
    """Page of one process. `make_session` creates the session of a new tab."""

    def __init__(self, make_session: Callable[[], PageSession], token: str | None = None) -> None:
        self.token = secrets.token_urlsafe(24) if token is None else token
        self._make_session = make_session
        self._sessions: OrderedDict[str, PageSession] = OrderedDict()
        self._sockets: dict[str, web.WebSocketResponse] = {}
        self._pool = ThreadPoolExecutor(2, thread_name_prefix="design")
        self._searches = ThreadPoolExecutor(2, thread_name_prefix="search")

    def application(self) -> web.Application:
        """Build the aiohttp application."""
        app = web.Application(middlewares=[self._guard], client_max_size=_LARGEST_MESSAGE)
        app.router.add_get("/", self._index)
        app.router.add_get("/page/{name}", self._static)
        app.router.add_get("/talk", self._talk)
        app.router.add_get("/file/{kind}", self._file)
        app.on_shutdown.append(self._close)
        return app

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Admit requests that carry the token, address us by our own host name, and come from our own page."""
        host = request.headers.get("Host", "").rsplit(":", 1)[0]
        origin = request.headers.get("Origin")
        given = request.query.get("token") or request.cookies.get(_COOKIE, "")
        known = secrets.compare_digest(given.encode(), self.token.encode())
        ours = origin is None or origin == f"http://{request.headers.get('Host', '')}"
        if not known or host not in (LOOPBACK, "localhost") or not ours:
            return web.Response(status=403, text=_NO_ENTRY, headers=_SAFE)
        response = await handler(request)
        if not response.prepared:
            response.headers.update(_SAFE)
        return response

    async def _index(self, request: web.Request) -> web.StreamResponse:
        if "token" in request.query:  # a redirect keeps the token out of the browser's history
            response = web.Response(status=303, headers={"Location": "/"})
            response.set_cookie(_COOKIE, self.token, httponly=True, samesite="Strict", path="/")
            return response
        return _resource("index.html")

    async def _static(self, request: web.Request) -> web.StreamResponse:
        return _resource(request.match_info["name"])

    async def _file(self, request: web.Request) -> web.StreamResponse:
        session = self._sessions.get(request.query.get("tab", ""))
        if session is None:
            return web.Response(status=404, text="this tab has no design; reload the page\n")
        try:
            file = await self._run(session.file, request.match_info["kind"], _angle(request.query.get("angle", "0")))
        except TwinError as error:
            return web.Response(status=400, text=f"{' '.join(str(error).split())}\n")
        disposition = f'attachment; filename="{file.name}"'
        return web.Response(body=file.content, content_type=file.kind, headers={"Content-Disposition": disposition})

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        socket_ = web.WebSocketResponse(heartbeat=_HEARTBEAT_S, compress=False, max_msg_size=_LARGEST_MESSAGE)
        await socket_.prepare(request)
        tab = request.query.get("tab", "")[:64]
        if tab in self._sockets and not self._sockets[tab].closed:  # a duplicated tab gets its own session
            tab = self._part(tab)
            self._sockets[tab] = socket_
            await self._send(tab, Arrays().packed({"type": "tab", "tab": tab}), None)
        self._sockets[tab] = socket_
        session = self._session(tab)
        searching: asyncio.Task[None] | None = None
        later: asyncio.Task[None] | None = None
        async for message in socket_:
            if message.type is not WSMsgType.TEXT:
                continue
            request_: dict[str, Any] = {}
            try:
                request_ = _parsed(message.data)
                if request_.get("type") == "stop":
                    session.stop()
                elif request_.get("type") == "search":
                    if searching and not searching.done():
                        raise SceneError("a search is running in this tab; stop it first")
                    searching = asyncio.create_task(self._search(tab, session, request_))
                else:
                    await self._send(tab, await self._run(session.answer, request_), request_.get("id"))
                    if session.awaited and (later is None or later.done()):
                        later = asyncio.create_task(self._later(tab, session))
            except Exception as error:
                await self._send(tab, _error(error), request_.get("id"))
        if self._sockets.get(tab) is socket_:
            del self._sockets[tab]
        return socket_

    async def _search(self, tab: str, session: PageSession, request: dict[str, Any]) -> None:
        loop = asyncio.get_running_loop()

        def report(message: bytes) -> None:
            asyncio.run_coroutine_threadsafe(self._send(tab, message, None), loop)

        try:
            done = await loop.run_in_executor(self._searches, session.search, request, report)
        except Exception as error:
            done = _error(error)
        await self._send(tab, done, request.get("id"))

    async def _later(self, tab: str, session: PageSession) -> None:
        """Send the state again once the loops that it waits for are compiled."""
        while awaited := session.awaited:
            await asyncio.wait([asyncio.wrap_future(awaited)])
        try:
            state = await self._run(session.state)
        except Exception as error:
            state = _error(error)
        await self._send(tab, state, None)

    async def _send(self, tab: str, message: bytes, number: Any) -> None:
        """Send to the present connection of a tab, if it has one; `number` identifies the message that this answers."""
        socket_ = self._sockets.get(tab)
        if socket_ is not None and not socket_.closed:
            known = number if isinstance(number, int) and 0 <= number < 2**32 else 0
            with suppress(ConnectionError, RuntimeError):  # the tab was closed meanwhile
                await socket_.send_bytes(known.to_bytes(4, "little") + message)

    def _session(self, tab: str) -> PageSession:
        if tab not in self._sessions:
            self._sessions[tab] = self._make_session()
            for old in [name for name in self._sessions if name not in self._sockets]:
                if len(self._sessions) > _MOST_SESSIONS:  # remove closed tabs, the longest unused first
                    del self._sessions[old]
        self._sessions.move_to_end(tab)
        return self._sessions[tab]

    def _part(self, tab: str) -> str:
        """Create a new tab name, with a copy of the session of another tab."""
        other = secrets.token_hex(16)
        self._sessions[other] = self._sessions[tab].copy()
        return other

    async def _run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._pool, function, *arguments)

    async def _close(self, _: web.Application) -> None:
        for session in self._sessions.values():
            session.stop()
        for socket_ in list(self._sockets.values()):
            await socket_.close(message=b"the page was ended")
        self._searches.shutdown(wait=False, cancel_futures=True)
        self._pool.shutdown(wait=False, cancel_futures=True)


def _parsed(text: str) -> dict[str, Any]:
    """Parse a message.

    Raises:
        SceneError: The text is not a JSON object.
    """
    try:
        parsed = json.loads(text)
    except (ValueError, RecursionError):
        parsed = None
    if not isinstance(parsed, dict):
        raise SceneError("a message must be an object, written as JSON")
    return parsed


def _angle(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise SceneError(f"angle: must be a number, not '{text[:40]}'") from None


def _error(error: BaseException) -> bytes:
    known = isinstance(error, TwinError)
    text = (
        str(error)
        if known
        else f"an internal error of textile-twin; please report it ({type(error).__name__}: {error})"
    )
    return Arrays().packed({"type": "error", "text": " ".join(text.split())})


def _resource(name: str) -> web.Response:
    ending = name.rsplit(".", 1)[-1]
    file = files("textile_twin_core.explore").joinpath("page", name)
    if "/" in name or ending not in _KINDS or not file.is_file():
        return web.Response(status=404, text="there is no such file\n")
    return web.Response(body=file.read_bytes(), content_type=_KINDS[ending], charset="utf-8")


def serve(page: Page, port: int, started: Callable[[str], None]) -> None:
    """Serve until interrupted; call `started` with the address, token included.

    Raises:
        SceneError: The port is in use.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOOPBACK, port))
    except (OSError, OverflowError) as error:
        listener.close()
        raise SceneError(f"port {port} cannot be used ({error}); give another by --port, or 0 for any") from None
    address = f"http://{LOOPBACK}:{listener.getsockname()[1]}/?token={page.token}"
    gc.freeze()  # spares garbage collections the loaded modules while a slider moves
    web.run_app(page.application(), sock=listener, print=lambda *_: started(address), handle_signals=True)
