"""The grasp editor in a real browser, over the service that plans."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PLATE = "polygon=0,0;0.06,0;0.06,0.03;0,0.03"
CROSSED = "polygon=0,0;0.06,0.03;0.06,0;0,0.03"
LENGTHS = """lines => lines.map(l => [Number(l.dataset.whisker), Math.hypot(
  l.x2.baseVal.value - l.x1.baseVal.value, l.y2.baseVal.value - l.y1.baseVal.value)])"""


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


def _open(page: Any, server: RunningServer, state: str) -> None:
    page.goto(f"{server.url}/tools/grasp#{state}")
    page.locator("[data-row]").first.wait_for()


def _vertices(page: Any) -> list[list[float]]:
    found: list[list[float]] = json.loads(page.locator("#points").input_value())
    return found


@pytest.mark.parametrize("look", EACH_LOOK)
def test_there_is_a_whisker_or_a_dot_for_each_grasp_and_the_best_is_the_longest(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        _open(page, server, "")  # starts with an example
        outline = _vertices(page)
        body = {"polygon": outline, "grasps": 100}
        planned = httpx.post(f"{server.url}/services/example/Grasping/plan", json=body).json()
        chances = [one["probability"] for one in planned["grasps"]]
        assert 0.0 in chances  # else there would be no dot to see
        assert page.locator("[data-row]").count() == len(chances)
        assert f": {len(chances)} grasps" in page.locator("[data-said]").inner_text()
        assert page.locator(".failed").count() == chances.count(0.0)
        lengths = dict(page.locator("[data-whisker]").evaluate_all(LENGTHS))
        assert len(lengths) == len(chances) - chances.count(0.0)
        assert lengths[0] == pytest.approx(max(lengths.values()), rel=1e-3)
        for rank, length in lengths.items():
            share = chances[rank] / chances[0]
            assert length == pytest.approx(share * lengths[0], rel=1e-3)  # drawn in float32
        assert page.locator(".label").text_content() == f"{chances[0]:.2f}"
        page.locator('[data-row="2"]').click()
        assert page.locator(".whisker.selected").get_attribute("data-whisker") == "2"
        has_count(page.locator(".jaw"), 2)
        page.locator('.hit[data-grasp="5"]').dispatch_event("click")
        assert page.locator("[data-row][aria-selected=true]").get_attribute("data-row") == "5"
        assert fits(page)
        keep_picture(page, f"grasp-editor-{look}")


def test_an_outline_is_drawn_by_mouse_and_undone(browser: Any, server: RunningServer) -> None:
    # For a moment the outline crosses itself; a slow machine plans in that moment, and is refused.
    with open_page(browser, server.url, expected=("422",), **LOOKS["laptop-light"]) as page:
        _open(page, server, PLATE)
        corner = page.locator('[data-vertex="2"]').bounding_box()
        x, y = corner["x"] + corner["width"] / 2, corner["y"] + corner["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 40, y, steps=4)
        page.mouse.up()
        assert _vertices(page)[2][0] > 0.06
        assert len(_vertices(page)) == 4
        page.locator('[data-edge="0"]').dispatch_event("dblclick")
        assert len(_vertices(page)) == 5
        page.mouse.click(x + 60, y - 60)  # beside the part
        assert len(_vertices(page)) == 6
        for _ in range(3):
            page.get_by_role("button", name="Undo").click()
        assert _vertices(page) == [[0, 0], [0.06, 0], [0.06, 0.03], [0, 0.03]]


def test_an_outline_is_drawn_and_a_grasp_chosen_by_keyboard_alone(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        _open(page, server, PLATE)
        page.keyboard.press("Tab")
        while page.evaluate("() => document.activeElement.dataset.do") != "clear":
            page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        assert _vertices(page) == []
        while page.evaluate("() => document.activeElement.tagName") != "svg":
            page.keyboard.press("Tab")
        for key in ("Enter", "Enter", "Shift+ArrowRight", "Enter"):
            page.keyboard.press(key)
        page.get_by_text("they lie on one line").wait_for()
        # A moment later the address has three vertices; a plan asked for would be a fault by then.
        page.wait_for_url(re.compile(r"polygon=[^;]+;[^;]+;[^;]+$"))
        page.keyboard.press("Shift+ArrowUp")
        (x0, y0), (x1, y1), (x2, y2) = _vertices(page)
        assert x1 > x0
        assert (y0, y0 < y2) == (y1, True)
        page.locator("[data-row]").first.wait_for()
        page.keyboard.press("ArrowLeft")
        assert _vertices(page)[2][0] < x2
        page.keyboard.press("Control+z")
        assert _vertices(page)[2][0] == x2
        page.keyboard.press("PageUp")
        page.keyboard.press("Delete")
        assert _vertices(page) == [[x0, y0], [x2, y2]]
        assert page.locator("[data-row]").count() == 0
        page.keyboard.press("Control+z")
        page.locator("[data-row]").first.wait_for()
        while page.evaluate("() => document.activeElement.tagName") != "TR":
            page.keyboard.press("Tab")
        page.keyboard.press("ArrowDown")
        assert page.locator("[aria-selected=true]").get_attribute("data-row") == "1"


def test_the_address_holds_outline_and_settings(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url) as page:
        _open(page, server, PLATE)
        page.get_by_label("friction").fill("0.4")
        page.get_by_label("Vertices in m").fill("0, 0\n0.05, 0\n0, 0.04")
        page.get_by_role("button", name="Use this outline").click()
        page.wait_for_url(re.compile("polygon=0,0;0.05,0;0,0.04&friction=0.4$"))
        address = page.url
    with open_page(browser, server.url) as page:
        page.goto(address)
        page.locator("[data-row]").first.wait_for()
        assert _vertices(page) == [[0, 0], [0.05, 0], [0, 0.04]]
        assert page.get_by_label("friction").input_value() == "0.4"


def test_a_crossing_outline_shows_the_words_of_the_service_and_no_whiskers(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, expected=("422",)) as page:
        _open(page, server, PLATE)
        page.evaluate("hash => { location.hash = hash; }", CROSSED)
        page.get_by_role("alert").get_by_text("edge").wait_for()
        body = {"polygon": [[0, 0], [0.06, 0.03], [0.06, 0], [0, 0.03]]}
        refused = httpx.post(f"{server.url}/services/example/Grasping/plan", json=body).json()
        assert page.locator("[data-problem]").inner_text() == refused["detail"]
        assert page.locator("[data-whisker], .failed, [data-row]").count() == 0


def test_grasps_are_saved_as_svg_csv_and_json(
    browser: Any, server: RunningServer, tmp_path: Path
) -> None:
    saved = {}
    with open_page(browser, server.url) as page:
        _open(page, server, PLATE)
        rows = page.locator("[data-row]").count()
        for kind in ("SVG", "CSV", "JSON"):
            with page.expect_download() as download:
                page.get_by_role("button", name=kind, exact=True).click()
            download.value.save_as(tmp_path / kind)
            saved[kind] = (tmp_path / kind).read_text(encoding="utf-8")
        whiskers = page.locator("[data-whisker]").count()
    assert saved["SVG"].count("data-whisker") == whiskers > 0
    assert "class=" not in saved["SVG"]
    assert len(saved["CSV"].splitlines()) == rows + 1
    kept = json.loads(saved["JSON"])
    assert len(kept["answer"]["grasps"]) == rows
    assert kept["request"]["polygon"][2] == [0.06, 0.03]


def test_a_stopped_server_is_said_and_the_page_goes_on_when_it_is_back(browser: Any) -> None:
    with running_server(None) as server, open_page(browser, server.url, expected=("ERR_",)) as page:
        _open(page, server, PLATE)
        server.stop(signal.SIGKILL)
        page.get_by_label("friction").fill("0.3")
        bar = page.get_by_role("alert").filter(has_text="No answer from the server since")
        bar.wait_for()
        with running_server(None, "-p", str(server.port)):
            bar.wait_for(state="hidden")
            assert page.locator("[data-row]").count() > 0
