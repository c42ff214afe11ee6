"""The audience of the proof picks the weak end in a browser, and sees what happens."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from simulate.demo.proof_page import write_proof
from simulate.demo.proof_stage import Stage, StageConsole
from tests.simulate.demo.test_proof import result_of_a_proof

pytestmark = pytest.mark.slow

PHONE = {"width": 390, "height": 844}


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    opened = Stage(tmp_path / "report")
    yield opened
    opened.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    opened = browser.new_page()
    yield opened
    opened.close()


def test_the_pick_of_the_audience_is_what_the_proof_waits_for(
    stage: Stage, page: Any, tmp_path: Path
) -> None:
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(stage.url)
    assert stage.wait(0) is None  # nothing is decided beforehand
    page.get_by_role("button", name="the right end").click()
    assert stage.wait(60) == "right"
    page.get_by_text("The right end is weak.").wait_for()
    assert not page.get_by_role("button", name="the left end").is_visible()
    console = StageConsole(stage, results=False)
    console.step("nao-1 <finds> out")
    page.get_by_text("nao-1 <finds> out").wait_for()
    console.table("at one table", ("attempt", "alone"), [("1", "held & put")])
    page.get_by_role("cell", name="held & put").wait_for()
    assert not page.get_by_role("heading", name="The report").is_visible()
    page.reload()  # nothing is lost, and nothing is there twice
    page.get_by_role("cell", name="held & put").wait_for()
    assert page.get_by_role("table").count() == 1
    (tmp_path / "report").mkdir()
    write_proof(tmp_path / "report", result_of_a_proof())
    stage.finish()
    report = page.frame_locator("iframe")
    report.get_by_role("heading", name="One carton, three robots").wait_for()
    assert report.get_by_text("yes", exact=True).count() == 6
    assert faults == []


def test_only_the_first_pick_counts_and_only_our_own_page_picks(stage: Stage) -> None:
    address = f"{stage.url}weak"
    foreign = {"Origin": "https://example.org"}
    assert httpx.post(address, data={"end": "left"}, headers=foreign).status_code == 403
    rebound = {"Host": "evil.example"}
    assert httpx.get(stage.url, headers=rebound).status_code == 403
    assert httpx.post(address, data={"end": "middle"}).status_code == 400
    assert httpx.post(address, content=b"").status_code == 404
    assert stage.wait(0) is None
    assert httpx.post(address, data={"end": "left"}).status_code == 303
    httpx.post(address, data={"end": "right"})
    assert stage.wait(0) == "left"


def test_no_file_beside_the_report_is_given_away(stage: Stage, tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    (tmp_path / "secret.json").write_text("{}")
    (tmp_path / "report" / "proof.html").write_text("<p>here</p>")
    (tmp_path / "report" / "notes.py").write_text("")
    assert httpx.get(f"{stage.url}report/proof.html").text == "<p>here</p>"
    for name in ("../secret.json", "%2e%2e/secret.json", "notes.py", "none.html", ""):
        assert httpx.get(f"{stage.url}report/{name}").status_code == 404


def test_the_end_is_picked_and_the_report_opened_by_keyboard_alone_on_a_phone(
    stage: Stage, page: Any, tmp_path: Path
) -> None:
    page.set_viewport_size(PHONE)
    page.goto(stage.url)
    for name in ("the left end", "the right end"):
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == name
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Enter")
    assert stage.wait(60) == "left"
    page.get_by_text("The left end is weak.").wait_for()
    (tmp_path / "report").mkdir()
    write_proof(tmp_path / "report", result_of_a_proof())
    stage.finish()
    page.get_by_role("heading", name="The report").wait_for()
    assert_fits(page)
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.get_by_role("heading", name="The teachers").wait_for()
    page.get_by_role("heading", name="nao-1 is withdrawn, and comes back").wait_for()
    assert_fits(page)


def assert_fits(page: Any) -> None:
    """Nothing is wider than the screen."""
    wide = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
    assert wide <= 0


@pytest.mark.deep
@pytest.mark.night
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("end", "is_by_keyboard"), [("right", False), ("left", True)])
def test_a_proof_runs_with_the_end_that_was_picked_in_a_browser(
    page: Any, tmp_path: Path, end: str, is_by_keyboard: bool
) -> None:
    command = [sys.executable, "-m", "rtask", "demo", "--proof", "--page", "--json"]
    command += ["--data", str(tmp_path / "proof")]
    with (
        (tmp_path / "said.txt").open("w") as later,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as running,
    ):
        assert running.stdout is not None
        assert running.stderr is not None
        address = re.search(r"http://\S+", running.stderr.readline())
        assert address is not None
        draining = threading.Thread(target=shutil.copyfileobj, args=(running.stderr, later))
        draining.start()  # a full pipe would stop the proof
        if is_by_keyboard:
            page.set_viewport_size(PHONE)
        page.goto(address[0])
        if is_by_keyboard:
            page.keyboard.press("Tab")  # to the left end, which is the first
            page.keyboard.press("Enter")
        else:
            page.get_by_role("button", name=f"the {end} end").click()
        result = json.loads(running.stdout.readline())
        said = page.get_by_role("log").inner_text()
        report = page.frame_locator("iframe")
        report.get_by_role("heading", name="The teachers").wait_for()
        points = report.locator("main > ul").first.get_by_role("listitem").all_inner_texts()
        running.terminate()
        draining.join()
    assert result["weak"] == end
    assert points == [f"yes {point['text']}" for point in result["points"]]
    assert len(points) == 6
    for words in ("withdrawn", "undone", "failed", "held; remembered grasp"):
        assert words in said, said
