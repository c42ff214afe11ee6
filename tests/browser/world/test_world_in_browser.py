"""The page of the world in a real browser: one slides to another time, and the drawing follows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import rtask
from rtask.rdf.namespaces import PREFIXES
from tests.browser.every_page.audits import AUDITS
from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.rtask.world.conftest import _LAB, BASE, Lab
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("world") / "store"
    with rtask.open(folder, base=BASE) as kb:
        kb.update(_LAB)
        lab = Lab(kb)
        lab.stand(lab.table, lab.map, 2.0, 0.0, 0.0)
        lab.stand(lab.frame(), lab.map, 1.5, 0.0, 0.0)
        lab.see(lab.box, 0.3, -0.1, 10.0, frame=lab.table)
        lab.stand(f"{BASE}frame/bin", lab.map, 2.0, 1.0, 0.0)
        kb.update(
            f"{PREFIXES} INSERT DATA {{ <{BASE}frame/bin> a rt:Frame ; rt:frameId 'bin' . "
            "<urn:bin> a rt:SupportSurface ; rt:name 'bin' ; rt:surfaceLength 0.3e0 ; "
            f"rt:surfaceWidth 0.2e0 ; rt:rimHeight 0.1e0 ; rt:bodyFrame <{BASE}frame/bin> }}"
        )
        lab.put(lab.see(lab.cup, 0.3, 0.3, 10.0, frame=lab.table), "in", lab.left_box, 600.0)
    with running_server(folder) as running:
        yield running


@pytest.mark.parametrize("look", EACH_LOOK)
def test_sliding_to_a_time_draws_and_lists_what_was_there(
    browser: Any, site: RunningServer, look: str
) -> None:
    with open_page(browser, site.url, **LOOKS[look]) as page:
        page.set_viewport_size({**LOOKS[look]["viewport"], **_narrow(look)})
        page.goto(f"{site.url}/world")
        slider = page.get_by_label("Slide from the first change to the last")
        drawing = page.locator("[data-drawing]")
        page.get_by_text("1 thing, 1 robot in the frame map").wait_for()
        assert drawing.get_by_text("blue cup").count() == 0
        slider.evaluate("""slide => {
          slide.value = Number(slide.min) + 300;
          slide.dispatchEvent(new Event("input"));
        }""")
        page.get_by_text("2 things, 1 robot in the frame map").wait_for()
        assert drawing.get_by_text("blue cup").count() == 1
        assert drawing.get_by_text("bin").count() == 1
        assert drawing.locator(".line.place").count() == 12  # the edges of a box
        assert drawing.locator(".line.other").count() == 1  # the table, as far as it was seen
        row = page.get_by_role("row").filter(has_text="blue cup")
        assert "2.300, 0.300, 0.000" in row.inner_text()
        assert "2025-11-28T12%3A05%3A00" in page.url
        assert "2025-11-28T12%3A05%3A00" in page.locator("[data-export=glb]").get_attribute("href")
        for name, script in AUDITS.items():
            assert page.evaluate(script) == [], name
        assert fits(page)
        keep_picture(page, f"world-{look}")
        page.locator("[data-after]").press("Enter")
        page.get_by_text("1 thing, 1 robot in the frame map").wait_for()
        assert (
            "in left box, whose pose is not known" in page.locator("[data-unplaced]").inner_text()
        )


def _narrow(look: str) -> dict[str, int]:
    return {"width": 390} if look.startswith("phone") else {}
