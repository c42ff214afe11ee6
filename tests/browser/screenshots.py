"""Screenshots for the documentation: ``python -m tests.browser.screenshots STORE [PICTURE ...]``.

STORE is a folder that a demo left, ``rtask-demo/store``; it is copied, not changed. Without a
PICTURE all are taken.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import httpx
from playwright.sync_api import Page, sync_playwright

from tests.browser.conftest import CHROMIUM, OPTIONS, WEBGL
from tests.browser.pages import LAPTOP, PHONE
from tests.servers import running_server

IMAGES = Path(__file__).parents[2] / "docs" / "images"
_SHOWN = {
    "page-object": ("/object?iri={object}#grasp=1", LAPTOP, "light"),
    "page-outcomes-phone": ("/feedback", PHONE, "dark"),
    "page-activity": ("/activity", LAPTOP, "light"),
    "page-arm": ("/tools/arm", LAPTOP, "light"),
}


def _take(page: Page, path: Path) -> None:
    """Save what the window shows, once nothing is loading."""
    page.wait_for_load_state("networkidle")
    page.wait_for_function("() => [...document.images].every((i) => i.complete || i.loading)")
    page.screenshot(path=str(path))


def _plan_for_panda(page: Page) -> None:
    """Show the path of an arm around a ball, half way."""
    page.locator(".link.goal").first.wait_for()
    page.locator("[data-robot]").select_option("robots/Panda")
    page.get_by_label("panda_joint7, rad or m").wait_for()
    page.get_by_role("button", name="Plan", exact=True).click()
    page.get_by_role("button", name="Play").wait_for()
    page.locator("[data-player] [name=at]").fill("30")
    page.locator("[data-robot]").scroll_into_view_if_needed()


def main() -> None:
    """Take every screenshot at its size and in its theme."""
    store, wanted = Path(sys.argv[1]), sys.argv[2:] or list(_SHOWN)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "store"
        shutil.copytree(store, copy)
        with running_server(copy) as server, sync_playwright() as playwright:
            objects = httpx.get(f"{server.url}/objects.json", timeout=60).json()["objects"]
            options = [option for option in OPTIONS if option != "--disable-gpu"]
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*options, *WEBGL])
            for name, (address, size, theme) in ((one, _SHOWN[one]) for one in wanted):
                context = browser.new_context(
                    viewport=size,  # type: ignore[arg-type]  # playwright's own type of a size
                    color_scheme=theme,  # type: ignore[arg-type]
                    locale="en",
                    device_scale_factor=1,
                )
                page = context.new_page()
                page.goto(
                    server.url + address.format(object=objects[0]["object"] if objects else "")
                )
                if "object" in name:
                    page.locator("[data-place][data-drawn]").wait_for()
                    page.locator("[data-cloud]").scroll_into_view_if_needed()
                if "arm" in name:
                    _plan_for_panda(page)
                if "activity" not in name:
                    _take(page, IMAGES / f"{name}.png")
                else:  # its stream of events never ends
                    page.get_by_text("live", exact=True).wait_for()
                    page.screenshot(path=str(IMAGES / f"{name}.png"))
                context.close()
            browser.close()


if __name__ == "__main__":
    main()
