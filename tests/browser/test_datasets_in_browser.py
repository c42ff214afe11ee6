"""Datasets in a real browser: files, versions, what differs, forks, and merges with conflicts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


def _upload(page: Any, name: str, text: str) -> None:
    page.get_by_text("Upload files").click()
    file = {"name": name, "mimeType": "text/plain", "buffer": text.encode()}
    page.get_by_label("files *").set_input_files([file])
    page.get_by_role("button", name="Upload").click()


def _make_version(page: Any, message: str) -> None:
    page.get_by_text("Make the head a version").click()
    page.get_by_label("message").fill(message)
    page.get_by_role("button", name="Make a version").click()


def _files(server: RunningServer, name: str) -> dict[str, str]:
    listed = httpx.get(f"{server.url}/datasets/{name}").json()["files"]
    return {path: httpx.get(f"{server.url}/datasets/{name}/files/{path}").text for path in listed}


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_dataset_grows_is_forked_and_merged_with_a_conflict(
    browser: Any, server: RunningServer, look: str
) -> None:
    ours, theirs = f"lab/Parts-{look}", f"lab/Other-{look}"
    options = {"java_script_enabled": False, **LOOKS[look]}
    with open_page(browser, server.url, expected=("409",), **options) as page:
        page.goto(f"{server.url}/datasets")
        assert page.get_by_role("link", name="robots/PlanarArm").count() == 1
        assert fits(page)
        page.get_by_label("name *").fill(ours)
        page.get_by_role("button", name="Create").click()
        _upload(page, "cup.txt", "cup")
        _upload(page, "bowl.txt", "bowl")
        _make_version(page, "cup and bowl")
        assert page.get_by_role("link", name="cup.txt").count() == 1
        page.get_by_text(f"Fork {ours}@1").click()
        page.get_by_label("name of the fork *").fill(theirs)
        page.get_by_role("button", name="Fork").click()
        _upload(page, "cup.txt", "their cup")
        _make_version(page, "another cup")
        page.goto(f"{server.url}/datasets/{ours}")
        _upload(page, "cup.txt", "our cup")
        page.get_by_role("button", name="Remove bowl.txt").click()
        has_count(page.get_by_role("link", name="bowl.txt"), 0)
        _make_version(page, "a better cup")
        page.get_by_label("Compare").select_option("1")
        page.get_by_label("with").select_option("2")
        page.get_by_role("button", name="Compare").click()
        differing = page.get_by_role("region", name="From 1 to 2").inner_text().split()
        assert differing[-4:] == ["changed", "cup.txt", "removed", "bowl.txt"]
        page.get_by_text("Merge a version into it").click()
        page.get_by_label("version *").fill(f"{theirs}@1")
        page.get_by_role("button", name="Merge", exact=True).click()
        conflicts = page.get_by_role("region", name="Conflicts")
        assert "both changed" in conflicts.inner_text()
        assert _files(server, ours) == {"cup.txt": "our cup"}
        assert fits(page)
        keep_picture(page, f"dataset-{look}")
        conflicts.get_by_label("theirs").check()
        conflicts.get_by_role("button", name="Merge").click()
        assert _files(server, ours) == {"cup.txt": "their cup"}
        assert fits(page)


def test_what_is_wrong_with_a_name_is_said_and_what_was_typed_is_kept(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, expected=("400", "409", "404")) as page:
        page.goto(f"{server.url}/datasets")
        page.get_by_label("name *").fill("no slash")
        page.get_by_role("button", name="Create").click()
        assert "expected <namespace>/<name>" in page.get_by_role("alert").inner_text()
        assert page.get_by_label("name *").input_value() == "no slash"
        page.get_by_label("name *").fill("robots/Point")
        page.get_by_role("button", name="Create").click()
        assert "exists already" in page.get_by_role("alert").inner_text()
        page.goto(f"{server.url}/datasets/robots/Pont")
        assert "did you mean 'robots/Point'" in page.locator("main").inner_text()
