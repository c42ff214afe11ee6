"""A person answers a robot on phone and laptop: the question comes by itself, with a picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.pages import fits, keep_picture, open_page
from tests.rtask.tasks.conftest import BASE, LAB
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SIZES = {
    "phone": {"viewport": {"width": 390, "height": 844}, "has_touch": True},
    "laptop": {"viewport": {"width": 1280, "height": 800}},
}
CHOICES = [
    {"code": "go_on", "text": "Try it as you are"},
    *({"code": "at", "text": f"It is at: the {number}th of the places in the long corridor",
       "helps": True} for number in range(6)),
]  # fmt: skip


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[RunningServer, str, Any]]:
    folder = tmp_path / "store"
    with rtask.open(folder, base=BASE) as kb:
        kb.update(LAB)
    with closing(TokenStore(folder)) as tokens:
        ann = tokens.create("teacher", agent="ann")[0]
        panda = tokens.create("robot", agent="panda-1")[0]
    with running_server(folder) as running, rtask.connect(running.url, token=panda) as robot:
        yield running, ann, robot


@pytest.mark.parametrize("size", SIZES)
def test_a_question_appears_is_read_and_answered(
    browser: Any, site: tuple[RunningServer, str, Any], size: str
) -> None:
    server, token, robot = site
    with rtask.connect(server.url, token=token) as ann:
        prices = {"asking_price": 5, "failing_price": 60}
        ann.call("store_plan", goal="every cup into the left box", **prices)
        ann.call("store_plan", goal="every pen into the right box")
    picture = bytes(cv2.imencode(".png", np.full((120, 160, 3), 200, np.uint8))[1])
    with open_page(browser, server.url, token, **SIZES[size]) as page:
        page.goto(f"{server.url}/questions")
        page.get_by_text("No robot waits for an answer").wait_for()
        step = robot.call("claim_step")
        text = "I do not see the red cup at the right box. Where is it?"
        asked = robot.call(
            "ask_person", task=step["task"], kind="where", text=text, choices=CHOICES,
            chance=0.0, picture=picture,
        )  # fmt: skip
        assert asked["asked"]
        other = robot.call("claim_step")  # it goes on with something else meanwhile
        assert "pen" in other["text"]
        robot.call("end_step", task=other["task"], result="released")
        page.get_by_role("heading", name=text).wait_for()  # without loading the page again
        assert fits(page)
        image = page.locator(".card img")
        assert image.evaluate("i => i.decode().then(() => i.naturalWidth)") == 160
        buttons = page.locator("button[name=choice]")
        sizes = buttons.evaluate_all(
            "all => all.map(b => [b.getBoundingClientRect().height, b.scrollWidth - b.clientWidth])"
        )
        assert len(sizes) == len(CHOICES)
        assert all(height >= 44 and cut <= 0 for height, cut in sizes)
        keep_picture(page, f"questions-{size}")
        page.get_by_role("button", name="the 3th of the places").click()
        page.get_by_text("Answered: the robot takes up its step again.").wait_for()
        assert fits(page)
    claimed = robot.call("claim_step")
    assert (claimed["answer"]["by"], claimed["answer"]["code"]) == ("ann", "at")
