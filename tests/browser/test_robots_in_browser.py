"""The pages of robots in a real browser: one comes, calls, offers a service, and is sent away."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import httpx
import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.browser.robots import robot
from tests.servers import RunningServer, bearer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

GRIPPER = {"name": "right", "gripper_type": "pinch", "max_opening": 0.08, "max_payload": 0.5}
NAO = "urn:lab/robot/nao-1"
PAGE = f"/robot?{urlencode({'iri': NAO})}"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str, str]]:
    folder: Path = tmp_path_factory.mktemp("robots") / "store"
    with rtask.open(folder, base="urn:lab/"), closing(TokenStore(folder)) as tokens:
        nao, _ = tokens.create("robot", agent="nao-1")
        admin, _ = tokens.create("admin")
    with running_server(folder) as running, robot(running, nao) as first:
        first.call("register_robot", name="nao-1", model="nao", end_effectors=[GRIPPER])
        first.leave()
        yield running, nao, admin


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_robot_comes_and_is_sent_away_on_open_pages(
    browser: Any, site: tuple[RunningServer, str, str], look: str
) -> None:
    server, token, admin = site
    with open_page(browser, server.url, admin, **LOOKS[look]) as page:
        page.goto(server.url + PAGE)
        page.get_by_text("not connected").wait_for()
        assert "last seen 20" in page.get_by_label("Now").inner_text()
        listed = page.context.new_page()
        listed.goto(f"{server.url}/robots")
        row = listed.get_by_role("row").filter(has_text="nao-1")
        row.locator("[data-label='Last seen']").get_by_text("20").wait_for()
        with robot(server, token) as nao:
            row.get_by_text("connected").wait_for()
            nao.send(op="advertise_service", service="/nao_1/say", type="lab/Say")
            nao.call("register_robot", name="nao-1", model="nao", end_effectors=[GRIPPER])
            page.get_by_text("/nao_1/say").wait_for()
            page.get_by_text("answered in").wait_for()
            row.get_by_text(" ms,").wait_for()
            assert fits(page)
            assert fits(listed)
            keep_picture(page, f"robot-connected-{look}")
            shown = httpx.get(f"{server.url}/robots.json", headers=bearer(admin)).json()
            (facts,) = shown["robots"]
            assert facts["connections"][0]["provides"] == ["/nao_1/say"]
            assert facts["calls"]["timed"] >= 2
            assert 0 < facts["calls"]["p50_ms"] <= facts["calls"]["p95_ms"]
            page.get_by_role("button", name="Disconnect it").press("Enter")
            assert nao.wait_until_closed().startswith("closed by ")
        page.get_by_text("not connected").wait_for()
        row.get_by_text("connected").wait_for(state="detached")


def test_without_scripts_only_operators_send_a_robot_away(
    browser: Any, site: tuple[RunningServer, str, str]
) -> None:
    server, token, admin = site
    with robot(server, token) as nao:
        nao.call("register_robot", name="nao-1", model="nao", end_effectors=[GRIPPER])
        with open_page(browser, server.url, token, java_script_enabled=False) as page:
            page.goto(server.url + PAGE)
            page.get_by_text("connected", exact=True).wait_for()
            assert page.get_by_role("button", name="Disconnect it").count() == 0
        refused = httpx.post(
            f"{server.url}/robot/disconnect", data={"robot": NAO}, headers=bearer(token)
        )
        assert refused.status_code == 403
        unknown = httpx.post(
            f"{server.url}/robot/disconnect", data={"robot": f"{NAO}0"}, headers=bearer(admin)
        )
        assert unknown.status_code == 404
        with open_page(browser, server.url, admin, java_script_enabled=False) as page:
            page.goto(server.url + PAGE)
            page.get_by_role("button", name="Disconnect it").click()
            page.get_by_text("not connected").wait_for()


def test_an_open_page_says_when_the_server_is_away_and_catches_up(
    browser: Any, tmp_path: Path
) -> None:
    folder = tmp_path / "store"
    lost = ("ERR_", "Failed to load")  # the browser complains of the server that is away
    with running_server(folder) as first, open_page(browser, first.url, expected=lost) as page:
        page.goto(f"{first.url}/robots")
        page.get_by_text("No robot yet").wait_for()
        first.stop()
        page.get_by_role("status").get_by_text("Not live since").wait_for()
        with rtask.open(folder) as kb:  # while nobody serves it
            robot_class = f"{ontology.PREFIXES['cora']}Robot"
            kb.update(
                f"""INSERT DATA {{ <urn:nao-9> a <{robot_class}> ;
                <{ontology.NS}name> "nao-9" }}""",
                "ann",
            )
        with running_server(folder, "-p", str(first.port)):
            page.get_by_role("link", name="nao-9").wait_for()
            page.get_by_text("Not live since").wait_for(state="hidden")
