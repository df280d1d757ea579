"""Server of the design page over real connections: access, tabs, interruptions, invalid messages."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import aiohttp
import pytest
from aiohttp import web

from tests.explore.unpack import numbers, unpack
from textile_twin_core import machines
from textile_twin_core.explore.design import Design
from textile_twin_core.explore.server import Page
from textile_twin_core.explore.session import PageSession

TOKEN = "token-of-the-test"
NONSENSE = (
    "",
    "{",
    "[]",
    "7",
    '{"type": 5}',
    '{"type": "change"}',
    '{"type": "search"}',
    '{"type": "pick"}',
    '{"type": "change", "values": {"crank_m": "NaN"}}',
    '{"type": "balance", "ripple": "x"}',
    '{"type": "load", "text": "machine: tufting", "name": "a\\u0000b"}',
    '{"type": "load", "text": "\\ud800", "name": "a.yaml"}',
    json.dumps({"type": "load", "text": "machine: tufting", "name": "a" * 300}),
    "[" * 100_000,
    *(json.dumps({"type": act, "free": free}) for act in ("search", "tolerance") for free in (5, "x", [1])),
    '{"type": "sensitivity", "free": 5}',
    *(
        json.dumps({"type": act, "free": {"crank_m": [40, 80]}, what: wrong})
        for act in ("search", "tolerance")
        for what in ("goals", "limits")
        for wrong in (5, "x", {"a": 1}, [1], [None], [{"value": 1}], [{"number": [], "value": 1}])
    ),
)
Visit = Callable[[aiohttp.ClientSession, str], Awaitable[None]]


def visit(act: Visit, jar: bool = True) -> None:
    """Serve a page on a free port and act on it."""

    async def run() -> None:
        page = Page(lambda: PageSession(Design.of(machines.handloom_beatup())), TOKEN)
        runner = web.AppRunner(page.application())
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        port = runner.addresses[0][1]
        cookies = aiohttp.CookieJar(unsafe=True) if jar else aiohttp.DummyCookieJar()
        async with aiohttp.ClientSession(cookie_jar=cookies) as client:
            await act(client, f"http://127.0.0.1:{port}")
        await runner.cleanup()

    asyncio.run(run())


async def ask(talk: aiohttp.ClientWebSocketResponse, **message: Any) -> dict[str, Any]:
    await talk.send_str(json.dumps(message))
    return await received(talk)


async def received(talk: aiohttp.ClientWebSocketResponse) -> dict[str, Any]:
    received = await talk.receive_bytes()
    return {"number": int.from_bytes(received[:4], "little"), **unpack(received[4:])[0]}


def test_requests_without_the_token_are_refused() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        for path in ("/", "/page/main.js", "/talk?tab=a", "/file/yaml?tab=a", "/?token=wrong", "/?token="):
            async with client.get(url + path) as answer:
                assert answer.status == 403 and "token" in await answer.text()
        for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
            async with client.get(f"{url}/?token={TOKEN}", headers=headers) as answer:
                assert answer.status == 403
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await client.ws_connect(url + "/talk?tab=a")

    visit(act, jar=False)


def test_token_becomes_a_cookie_and_leaves_the_address() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        async with client.get(f"{url}/?token={TOKEN}", allow_redirects=False) as answer:
            assert answer.status == 303 and answer.headers["Location"] == "/"
            cookie = answer.headers["Set-Cookie"]
            assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
        async with client.get(url + "/") as answer:
            assert answer.status == 200 and "default-src 'self'" in answer.headers["Content-Security-Policy"]
        for name in ("main.js", "charts.js", "style.css", "icon.svg"):
            async with client.get(f"{url}/page/{name}") as answer:
                assert answer.status == 200
        for name in ("..%2fserver.py", "server.py", "secrets.txt", "__init__.py"):
            async with client.get(f"{url}/page/{name}") as answer:
                assert answer.status == 404

    visit(act)


async def enter(client: aiohttp.ClientSession, url: str) -> None:
    async with client.get(f"{url}/?token={TOKEN}"):
        pass


def test_two_tabs_have_designs_of_their_own_and_a_lost_one_comes_back() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        await enter(client, url)
        async with client.ws_connect(url + "/talk?tab=one") as one, client.ws_connect(url + "/talk?tab=two") as two:
            changed = await ask(one, type="change", values={"crank_m": 55.0}, id=7)
            assert changed["number"] == 7
            other = await ask(two, type="hello", id=1)
            assert numbers(changed)["beater_stroke_m"] < numbers(other)["beater_stroke_m"]
        async with client.ws_connect(url + "/talk?tab=one") as again:
            assert numbers(await ask(again, type="hello")) == numbers(changed)

    visit(act)


@pytest.mark.slow
def test_sessions_are_few_and_those_of_open_tabs_stay() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        await enter(client, url)
        async with client.ws_connect(url + "/talk?tab=open") as one:
            first = await ask(one, type="change", values={"crank_m": 55.0})
            for number in range(70):
                async with client.ws_connect(f"{url}/talk?tab=closed{number}") as other:
                    await ask(other, type="hello")
            for tab, status in (("open", 200), ("closed69", 200), ("closed0", 404)):
                async with client.get(f"{url}/file/yaml?tab={tab}") as answer:
                    assert answer.status == status
            assert numbers(await ask(one, type="hello")) == numbers(first)

    visit(act)


def test_duplicated_tab_gets_its_own_session() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        await enter(client, url)
        async with client.ws_connect(url + "/talk?tab=one") as one:
            first = await ask(one, type="change", values={"crank_m": 55.0})
            async with client.ws_connect(url + "/talk?tab=one") as two:
                parted = await received(two)
                assert parted["type"] == "tab" and parted["tab"] != "one"
                assert numbers(await ask(two, type="hello")) == numbers(first)
                await ask(two, type="change", values={"crank_m": 50.0})
            assert numbers(await ask(one, type="hello")) == numbers(first)

    visit(act)


def test_nonsense_is_answered_and_the_page_stays_alive() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        await enter(client, url)
        async with client.ws_connect(url + "/talk?tab=one") as talk:
            for text in NONSENSE:
                await talk.send_str(text)
                answer = await received(talk)
                assert answer["type"] == "error" and answer["text"], text
                assert "internal error" not in answer["text"] and "\n" not in answer["text"], (text, answer)
            assert (await ask(talk, type="hello"))["type"] == "state"
        async with client.get(url + "/file/yaml?tab=nobody") as answer:
            assert answer.status == 404
        for path, says in (("exe", "no file of kind 'exe'"), ("png", "angle: must be a number, not 'east'")):
            angle = "&angle=east" if path == "png" else ""
            async with client.get(f"{url}/file/{path}?tab=one{angle}") as answer:
                assert answer.status == 400 and says in await answer.text()
        async with client.get(url + "/file/yaml?tab=one") as answer:
            assert answer.status == 200 and "handloom_beatup" in await answer.text()

    visit(act)


def test_search_reports_and_stops() -> None:
    async def act(client: aiohttp.ClientSession, url: str) -> None:
        await enter(client, url)
        task = {
            "free": {"crank_m": [40, 80], "coupler_m": [150, 250]},
            "goals": [{"number": "beater_dwell_rad", "sense": "max"}],
            "limits": [{"number": "smallest_transmission_angle_rad", "sense": ">=", "value": 50}],
            "seconds": 120,
        }
        async with client.ws_connect(url + "/talk?tab=one") as talk:
            first = await ask(talk, type="search", **task)
            assert first["type"] == "front" and first["running"]
            assert (await ask(talk, type="change", values={"crank_m": 58.0}))["type"] in ("state", "front")
            await talk.send_str('{"type": "stop"}')
            while True:
                last = await received(talk)
                if last["type"] == "front" and not last["running"]:
                    break
            assert last["designs"] >= 160 and not last["complete"]
            state = await ask(talk, type="pick", index=0)
            assert numbers(state)["smallest_transmission_angle_rad"] >= 50 - 1e-6

    visit(act)
