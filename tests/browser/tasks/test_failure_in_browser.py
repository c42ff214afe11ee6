"""A person lets what would have helped be tried, by keyboard alone on a phone."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.every_page.audits import AUDITS
from tests.browser.pages import LOOKS, fits, keep_picture, open_page
from tests.rtask.tasks.conftest import BASE, PEN, RIGHT
from tests.servers import running_server
from tests.simulate.tasks.test_trials_on_branches import failed_step

pytestmark = [pytest.mark.browser, pytest.mark.deep]


@pytest.mark.parametrize("look", LOOKS)
def test_what_would_have_helped_is_tried_by_keyboard(
    browser: Any, tmp_path: Path, look: str
) -> None:
    folder = tmp_path / "store"
    with rtask.open(folder, base=BASE) as kb:
        step = failed_step(kb, "ik")
    with closing(TokenStore(folder)) as tokens:
        ann = tokens.create("teacher", agent="ann")[0]
    where = f"ASK {{ <{PEN}> <https://w3id.org/rtask-kg/ns#locatedOn> <{RIGHT}> }}"
    with (
        running_server(folder) as server,
        open_page(browser, server.url, ann, **LOOKS[look]) as page,
    ):
        page.goto(f"{server.url}/why?iri={step}")
        page.get_by_role("button", name="Try what would have helped").focus()
        page.keyboard.press("Enter")
        page.get_by_role("button", name="Try again").wait_for()
        assert page.get_by_text("another place: panda-1 does not take it at table").is_visible()
        assert page.get_by_text("held", exact=True).first.is_visible()
        page.get_by_text("The plan, without physics").first.focus()
        page.keyboard.press("Enter")
        page.get_by_text("nao-1 puts pen into or onto middle").first.wait_for()
        assert fits(page)
        faults = {name: page.evaluate(script) for name, script in AUDITS.items()}
        assert not any(faults.values()), faults
        keep_picture(page, f"why-{look}")
        with rtask.connect(server.url, token=ann) as client:
            assert not client.ask(where)
