"""A person types a goal, reads the steps, and stores them for the robots, on phone and laptop."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.pages import SIZES, fits, open_page
from tests.rtask.tasks.conftest import BASE, LAB
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[RunningServer, dict[str, str]]]:
    folder = tmp_path / "store"
    with rtask.open(folder, base=BASE) as kb:
        kb.update(LAB)
    with closing(TokenStore(folder)) as store:
        tokens = {"ann": store.create("teacher", agent="ann")[0],
                  "panda-1": store.create("robot", agent="panda-1")[0]}  # fmt: skip
    with running_server(folder) as running:
        yield running, tokens


@pytest.mark.parametrize("size", ["phone", pytest.param("laptop", marks=pytest.mark.deep)])
def test_a_goal_is_typed_read_and_stored_and_a_robot_begins_it(
    browser: Any, site: tuple[RunningServer, dict[str, str]], size: str
) -> None:
    server, tokens = site
    look = {"viewport": SIZES[size], "has_touch": size == "phone"}
    with open_page(browser, server.url, tokens["ann"], **look) as page:
        page.goto(f"{server.url}/plan")
        page.get_by_role("searchbox", name="Goal").fill("the jug and every cup into the left box")
        page.get_by_role("button", name="Plan", exact=True).click()
        page.get_by_text("panda-1 picks red cup up from right box").wait_for()
        page.get_by_text("it is not known that panda-1 reaches left box").first.wait_for()
        assert fits(page)
        page.locator("summary", has_text="Why it is possible").first.click()
        page.get_by_role("link", name="panda-1 can grasp red cup").wait_for()
        store = page.get_by_role("button", name="Store what is possible")
        assert size != "phone" or store.bounding_box()["height"] >= 44
        store.click()
        page.get_by_text("Robots can carry it out.").wait_for()
        assert fits(page)
        with rtask.connect(server.url, token=tokens["panda-1"]) as robot:
            assert robot.call("claim_step")["text"] == "panda-1 picks red cup up from right box"
