"""The live page in a real browser: robots come, see, ask, report and leave."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.pages import EACH_LOOK, LOOKS, PHONE, fits, keep_picture, open_page
from tests.browser.robots import Robot, robot
from tests.browser.waiting import has_count
from tests.servers import RunningServer, bearer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

GRIPPER = {
    "name": "right",
    "gripper_type": "pinch",
    "max_opening": 0.08,
    "max_payload": 0.5,
}


def _folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A store with a mug, and the token of nao-1."""
    folder = tmp_path_factory.mktemp("watched") / "store"
    prefixes = f"PREFIX rt: <{ontology.NS}>"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(
            f"""{prefixes} INSERT DATA {{ <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" ;
            rt:name "blue mug" ; rt:hasGrasp <urn:lab/grasp/1> .
            <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "pinch" . }}""",
            "ann",
        )
    with closing(TokenStore(folder)) as tokens:
        token, _ = tokens.create("robot", agent="nao-1")
    return folder, token


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    folder, token = _folder(tmp_path_factory)
    with running_server(folder) as running:
        yield running, token


def _camera_picture(width: int) -> str:
    _, jpeg = cv2.imencode(".jpg", np.full((48, width, 3), 90, np.uint8))
    return base64.b64encode(jpeg.tobytes()).decode()


def _see(robot: Robot, width: int) -> None:
    type_ = "sensor_msgs/CompressedImage"
    robot.send(op="advertise", topic="/nao-1/camera", type=type_, latch=True)
    message = {"format": "jpeg", "data": _camera_picture(width)}
    robot.send(op="publish", topic="/nao-1/camera", msg=message)


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_robot_comes_sees_reports_and_leaves_on_an_open_page(
    browser: Any, site: tuple[RunningServer, str], look: str
) -> None:
    server, token = site
    with open_page(browser, server.url, **LOOKS[look]) as page:
        page.goto(f"{server.url}/activity")
        page.get_by_text("live", exact=True).wait_for()
        lane = page.locator('[data-lane="nao-1"]')
        width = 64 if look == "laptop-light" else 80
        with robot(server, token) as nao:
            lane.get_by_text("connected").wait_for()
            nao.call("register_robot", name="nao-1", model="nao", end_effectors=[GRIPPER])
            _see(nao, width)
            camera = lane.get_by_role("img", name="What the camera of nao-1 sees")
            camera.wait_for()
            page.wait_for_function(
                "width => document.querySelector('[data-lane] img')?.naturalWidth === width",
                arg=width,
            )
            nao.call(
                "report_outcome", object="urn:lab/object/1", grasp="urn:lab/grasp/1",
                outcome={"success": False, "reason": "slip_lift", "comment": "opening 1 -> 0"},
            )  # fmt: skip
            said = "did not hold blue mug: it slipped out while being lifted"
            lane.get_by_text(said).wait_for()
            assert page.locator("[data-events] li").first.inner_text() != ""
            row = page.locator("[data-events] li[data-kind=outcome]").first
            assert row.get_by_role("link", name=said).get_attribute("href") is not None
            measured = row.get_by_text("opening 1 -> 0")
            assert not measured.is_visible()
            row.get_by_text("what it measured").click()
            measured.wait_for()
            assert page.locator("[data-events] li[data-kind=wrote]:visible").count() == 0
            assert fits(page)
            keep_picture(page, f"activity-{look}")
        lane.get_by_text("left", exact=True).wait_for()


def test_rows_are_filtered_held_back_and_found_again_after_a_reload(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, token = site
    with open_page(browser, server.url, viewport=PHONE) as page:
        page.goto(f"{server.url}/activity")
        page.get_by_text("live", exact=True).wait_for()
        page.get_by_role("button", name="Pause").click()
        with robot(server, token) as nao:
            nao.call("register_robot", name="nao-1", model="nao", end_effectors=[GRIPPER])
            nao.call(
                "report_outcome", object="urn:lab/object/1", grasp="urn:lab/grasp/1",
                outcome={"success": True},
            )  # fmt: skip
            resume = page.get_by_role("button", name="Resume (")
            resume.wait_for()
            held = page.locator("[data-events] li").filter(has_text="held blue mug")
            before = held.count()
            resume.click()
            held.nth(before).wait_for()
        page.get_by_label("What").select_option("outcome")
        kinds = page.locator("[data-events] li:visible").evaluate_all(
            "rows => [...new Set(rows.map(row => row.dataset.kind))]"
        )
        assert kinds == ["outcome"]
        page.reload()
        assert page.get_by_label("What").input_value() == "outcome"
        assert held.nth(before).is_visible()


def test_an_open_page_catches_up_with_a_restarted_server(
    browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, token = _folder(tmp_path_factory)
    lost = ("ERR_", "Failed to load")  # the browser complains of the server that is away
    with running_server(folder) as first:
        port = first.port
        with open_page(browser, first.url, expected=lost) as page:
            page.goto(f"{first.url}/activity")
            page.get_by_text("live", exact=True).wait_for()
            page.get_by_label("What").select_option("all")
            first.stop()
            page.get_by_text("not live since").wait_for()
            with rtask.open(folder) as kb:  # while nobody serves it
                for k in range(3):
                    kb.update(f"INSERT DATA {{ <urn:lab/x/{k}> <urn:p> 1 }}", "nao-9")
            with running_server(folder, "-p", str(port)) as second:
                page.get_by_text("live", exact=True).wait_for()
                rows = page.locator('[data-events] li[data-who="nao-9"]')
                rows.nth(2).wait_for()
                with robot(second, token):
                    page.locator('[data-lane="nao-1"]').get_by_text("connected").wait_for()
                assert rows.count() == 3


def test_without_scripts_the_page_shows_what_happened(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, _ = site
    with open_page(browser, server.url, java_script_enabled=False, viewport=PHONE) as page:
        page.goto(f"{server.url}/activity")
        assert page.get_by_text("told the graph of blue mug").count() == 1


def test_two_tabs_share_one_stream(browser: Any, site: tuple[RunningServer, str]) -> None:
    server, token = site
    with open_page(browser, server.url) as page:
        opened: list[str] = []
        page.context.on(
            "request", lambda r: opened.append(r.url) if "/activity/events" in r.url else None
        )
        page.goto(f"{server.url}/activity")
        page.get_by_text("live", exact=True).wait_for()
        other = page.context.new_page()
        other.goto(f"{server.url}/activity")
        other.get_by_text("live", exact=True).wait_for()
        with robot(server, token):
            for tab in (page, other):
                tab.locator('[data-lane="nao-1"]').get_by_text("connected").wait_for()
        assert len(opened) == 1


@pytest.mark.parametrize("commits", [450, pytest.param(1000, marks=pytest.mark.deep)])
def test_hundreds_of_commits_leave_the_page_usable(
    browser: Any, tmp_path_factory: pytest.TempPathFactory, commits: int
) -> None:
    folder, token = _folder(tmp_path_factory)
    rates = ("--rate", "100000", "--write-rate", "100000")
    with running_server(folder, *rates) as server, open_page(browser, server.url) as page:
        page.goto(f"{server.url}/activity")
        page.get_by_text("live", exact=True).wait_for()
        rows = page.locator("[data-events] li")
        with httpx.Client(base_url=server.url, headers=bearer(token), timeout=60) as client:
            for number in range(commits):
                if number == commits // 2:
                    page.get_by_role("button", name="Pause").click()
                update = f'INSERT DATA {{ <urn:lab/n/{number}> <urn:lab/p> "{number}" }}'
                client.post("/sparql", data={"update": update}).raise_for_status()
        page.get_by_role("button", name="Resume (200 waiting)").click()  # the last of them
        has_count(rows, 200)
        with robot(server, token) as nao:
            nao.call("register_robot", name="nao-1", model="nao", end_effectors=[GRIPPER])
            page.locator('[data-lane="nao-1"]').get_by_text("connected").wait_for()
        page.locator('[data-lane="nao-1"]').get_by_text("left", exact=True).wait_for()
        has_count(rows, 200)
        assert fits(page)
