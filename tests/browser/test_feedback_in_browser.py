"""People judge attempts in a real browser: by forms, by keys, on a phone, two at once."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from tests.browser.attempts import WIDTHS, store_of_attempts
from tests.browser.waiting import has_count
from tests.servers import RunningServer, bearer, running_server

ATTEMPTS = 22

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """A folder with attempts and their pictures, which each test copies."""
    folder = tmp_path_factory.mktemp("filled") / "store"
    return folder, *store_of_attempts(folder, ATTEMPTS)


@pytest.fixture
def site(filled: tuple[Path, str, str], tmp_path: Path) -> Iterator[tuple[RunningServer, str, str]]:
    """A server of its own for each test, and the tokens of two people."""
    folder, ann, bob = filled
    with running_server(shutil.copytree(folder, tmp_path / "store")) as running:
        yield running, ann, bob


def signed_in(browser: Any, server: RunningServer, token: str, **options: Any) -> Any:
    page = browser.new_context(locale="en", **options).new_page()
    page.set_default_timeout(60_000)
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on(
        "console",
        lambda said: page.faults.append(said.text) if said.type == "error" else None,
    )
    page.on(
        "request",
        lambda asked: (
            None
            if urlsplit(asked.url).netloc == urlsplit(server.url).netloc
            else page.faults.append(asked.url)
        ),
    )
    page.goto(f"{server.url}/login?next=/feedback")
    page.get_by_label("Access token").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url("**/feedback")
    return page


def verdicts(server: RunningServer, token: str) -> dict[str, list[tuple[str, bool, str]]]:
    """Return what people said of each attempt."""
    found = httpx.get(f"{server.url}/feedback.json", headers=bearer(token)).json()["attempts"]
    said = {one["attempt"].rpartition("/")[2]: one["verdicts"] for one in found}
    return {
        name: [(v["by"], v["held"], v["reason"]) for v in words] for name, words in said.items()
    }


def test_twenty_attempts_are_judged_by_keys_alone(
    browser: Any, site: tuple[RunningServer, str, str]
) -> None:
    server, token, _ = site
    page = signed_in(browser, server, token)
    card = page.locator("[data-attempt]:not(.off)")
    widths = card.locator(".shots img").evaluate_all(
        "images => Promise.all(images.map(i => i.decode().then(() => i.naturalWidth)))"
    )
    assert widths == [WIDTHS["pre_grasp"], WIDTHS["placed"]]
    assert card.locator(".strip span").all_inner_texts() == [
        "before the grasp",
        "hand closed",
        "held up",
        "put down",
    ]
    page.clock.install()
    page.keyboard.press("Y")
    page.keyboard.press("U")  # nothing of this is sent
    for number in range(20):
        assert card.get_attribute("data-attempt") == f"urn:lab/attempt/{number}"
        if number % 3:
            page.keyboard.press("y")
        else:
            page.keyboard.press("n")
            page.keyboard.press("2" if number % 2 else "Enter")
    page.keyboard.press("s")
    assert verdicts(server, token)["0"] == []
    page.clock.fast_forward(11_000)
    page.wait_for_function("() => document.querySelectorAll('.attempt-list .sent').length === 20")
    found = verdicts(server, token)
    assert [found[str(n)] for n in range(20)] == [
        [("ann", bool(n % 3), "slip_lift" if n % 3 == 0 and n % 2 else "")] for n in range(20)
    ]
    assert found["20"] == found["21"] == []
    # A page that is left sends at once, and nothing again when the browser brings it back.
    sent: list[str] = []
    page.on("request", lambda asked: sent.append(asked.url) if asked.method == "POST" else None)
    page.keyboard.press("y")
    page.evaluate("dispatchEvent(new PageTransitionEvent('pagehide', { persisted: true }))")
    page.wait_for_function("() => document.querySelectorAll('.attempt-list .sent').length === 21")
    page.clock.fast_forward(11_000)
    page.evaluate("() => fetch('/feedback.json')")
    assert len(sent) == 1
    assert page.faults == []
    page.context.close()


def test_letters_in_a_field_judge_nothing_and_can_be_switched_off(
    browser: Any, site: tuple[RunningServer, str, str]
) -> None:
    server, token, _ = site
    page = signed_in(browser, server, token)
    card = page.locator("[data-attempt]:not(.off)")
    card.get_by_label("Comment").fill("")
    card.get_by_label("Comment").press_sequentially("any nuys")
    assert card.get_attribute("data-attempt") == "urn:lab/attempt/0"
    page.get_by_label("Letter keys").uncheck()
    card.focus()
    page.keyboard.press("y")
    assert card.get_attribute("data-attempt") == "urn:lab/attempt/0"
    page.keyboard.press("ArrowRight")
    assert card.get_attribute("data-attempt") == "urn:lab/attempt/1"
    page.context.close()


def test_on_a_phone_nothing_scrolls_sideways_and_buttons_judge(
    browser: Any, site: tuple[RunningServer, str, str]
) -> None:
    server, token, _ = site
    page = signed_in(
        browser,
        server,
        token,
        viewport={"width": 360, "height": 740},
        has_touch=True,
        color_scheme="dark",
    )
    width = page.evaluate("() => document.documentElement.scrollWidth")
    assert width == 360
    judging = page.get_by_role("group", name="Judge this attempt")
    for button in judging.get_by_role("button").all():
        assert button.bounding_box()["height"] >= 44
    card = page.locator("[data-attempt]:not(.off)")
    _swipe(page, 0, -150)  # up skips
    assert card.get_attribute("data-attempt") == "urn:lab/attempt/1"
    page.keyboard.press("ArrowLeft")
    assert card.get_attribute("data-attempt") == "urn:lab/attempt/0"
    _swipe(page, -150, 0)  # to the left asks why it did not hold
    page.get_by_role("group", name="Why it did not hold").wait_for()
    page.keyboard.press("Escape")
    judging.get_by_role("button", name="Did not hold").tap()
    page.get_by_role("button", name="it slipped out while being held").tap()
    page.goto(f"{server.url}/objects")  # leaving sends what waits
    page.wait_for_load_state()
    assert _eventually(lambda: verdicts(server, token)["0"]) == [("ann", False, "slip_hold")]
    assert page.faults == []
    page.context.close()


def _swipe(page: Any, dx: int, dy: int) -> None:
    """Swipe over the pictures of the open card."""
    page.locator("[data-attempt]:not(.off) .shots").evaluate(
        """(shots, [dx, dy]) => {
             const at = (x, y) => ({ pointerType: "touch", bubbles: true, clientX: x, clientY: y });
             shots.dispatchEvent(new PointerEvent("pointerdown", at(180, 300)));
             shots.dispatchEvent(new PointerEvent("pointerup", at(180 + dx, 300 + dy)));
           }""",
        [dx, dy],
    )


def _eventually(read: Any) -> Any:
    """Return what a function finds as soon as it finds something; its last answer after 60 s."""
    for _ in range(1200):
        if found := read():
            return found
        time.sleep(0.05)
    return read()


def test_two_people_disagree_without_scripts_and_an_open_page_hears_of_it(
    browser: Any, site: tuple[RunningServer, str, str]
) -> None:
    server, token_ann, token_bob = site
    bob = signed_in(browser, server, token_bob)
    ann = signed_in(browser, server, token_ann, java_script_enabled=False)
    card = ann.locator("#attempt-0")
    card.get_by_text("Correct", exact=True).click()
    card.get_by_label("Outcome").select_option("false")
    card.get_by_label("Reason").select_option("slip_lift")
    card.get_by_role("button", name="Store the correction").click()
    ann.wait_for_url("**/feedback#attempt-0")
    has_count(card.get_by_text("ann: did not hold (it slipped out while being lifted)"), 1)

    bob.get_by_text("Somebody has just judged this attempt.").wait_for()
    assert bob.locator("#attempt-0").get_by_text("ann: did not hold").count() == 1
    bob.keyboard.press("y")
    bob.get_by_text("Sent in 10 s").wait_for()
    bob.goto(f"{server.url}/objects")
    assert _eventually(lambda: len(verdicts(server, token_bob)["0"]) == 2)
    ann.goto(f"{server.url}/feedback")
    assert card.get_by_text("disputed, nothing").count() == 1
    assert ann.faults == bob.faults == []
    for page in (ann, bob):
        page.context.close()
