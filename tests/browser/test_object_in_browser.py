"""The cloud and the grasps of an object in a real browser, in 3D and without WebGL."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import numpy as np
import pytest

import endpoint.pages.drawn as drawn
import ontology
import rtask
from features.modelling import mesh_to_ply
from tests.browser.pages import EACH_LOOK, LOOKS, SIZES, fits, keep_picture, open_page
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

HOSTILE = '"><img src=x onerror="document.title=1">'
PREFIXES = " ".join(
    f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("rt", "cora", "prov")
)
TWICE_HELD = "urn:lab/object/3"
OBJECT = "urn:lab/object/1"
SURFACED = "urn:lab/object/4"
POINTS = 3_000


def _ply() -> bytes:
    """A coloured box of 8 x 4 x 6 cm, 0.5 m in front of the camera."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (POINTS, 3)) * [0.08, 0.04, 0.06] + [0, 0, 0.5]
    colours = rng.integers(60, 220, (POINTS, 3))
    rows = "\n".join(
        f"{x:.5f} {y:.5f} {z:.5f} {r} {g} {b}"
        for (x, y, z), (r, g, b) in zip(points, colours, strict=True)
    )
    kinds = "".join(f"property float {a}\n" for a in "xyz") + "".join(
        f"property uchar {c}\n" for c in ("red", "green", "blue")
    )
    head = f"ply\nformat ascii 1.0\nelement vertex {POINTS}\n{kinds}end_header\n"
    return (head + rows + "\n").encode()


def _grasp(number: int, theta: float, attempts: str, owner: str = OBJECT) -> str:
    grasp = f"urn:lab/grasp/{number}"
    outcomes = "".join(
        f"""<{grasp}> rt:triedIn <{grasp}/a{k}> . <{grasp}/a{k}> a rt:GraspAttempt ;
        rt:performedBy <urn:lab/robot/1> ; rt:executesGrasp <{grasp}> ;
        rt:hasOutcome <{grasp}/o{k}> . <{grasp}/o{k}> a rt:GraspOutcome ;
        rt:success {"true" if held == "+" else "false"} ; rt:hasReason
        {"rt:reason_ok" if held == "+" else "rt:reason_slip_lift"} . """
        for k, held in enumerate(attempts)
    )
    return f"""<{owner}> rt:hasGrasp <{grasp}> . <{grasp}> a rt:PlanarGrasp ;
      rt:gripperType "pinch" ; rt:jawOpening 0.06e0 ; rt:graspPose <{grasp}/pose> .
      <{grasp}/pose> a rt:PlanarPose ; rt:x 0e0 ; rt:y {0.01 * number}e0 ; rt:z 0.5e0 ;
      rt:theta {theta}e0 . {outcomes}"""


def _surface() -> bytes:
    """Return a tetrahedron one of whose corners was not seen."""
    corners = 0.05 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0)])
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    colours = np.full((4, 3), (200, 60, 30), np.uint8)
    return mesh_to_ply(corners, faces, colours, np.array([False, True, True, True]))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("clouds") / "store"
    with rtask.open(folder, base="urn:lab/") as kb, kb.transaction(agent="1") as tx:
        blob = tx.blob(_ply(), "application/ply").value
        grasps = " ".join(
            _grasp(k, 0.5 * k, said) for k, said in enumerate(("+++", "+-", "--", ""), 1)
        )
        grasps += _grasp(5, 0.0, "++", TWICE_HELD)
        tx.update(f"""{PREFIXES} INSERT DATA {{
          <{OBJECT}> a rt:Box ; rt:objectId "lab/1" ; rt:hasView <urn:lab/view/1> .
          <urn:lab/view/1> a rt:View ; rt:viewpoint <urn:lab/pose/1> ;
            rt:viewContent <urn:lab/cloud/1> .
          <urn:lab/pose/1> a rt:Pose ; rt:x 0e0 ; rt:y 0e0 ; rt:z 0e0 ;
            rt:qx 0e0 ; rt:qy 0e0 ; rt:qz 0e0 ; rt:qw 1e0 .
          <urn:lab/cloud/1> a rt:PointCloud ; rt:hasBlob <{blob}> .
          <urn:lab/robot/1> a cora:Robot . {grasps}
          <{TWICE_HELD}> a rt:Box ; rt:objectId "lab/3" ; rt:hasView <urn:lab/view/1> .
          <urn:lab/object/2> a rt:Box ; rt:objectId "lab/2" . }}""")
        surface = tx.blob(_surface(), "model/ply").value
        tx.update(f"""{PREFIXES} INSERT DATA {{
          <{SURFACED}> a rt:Box ; rt:objectId "lab/4" ; rt:hasFeature <urn:lab/mesh/1> .
          <urn:lab/mesh/1> a rt:TriangleMesh ; rt:hasBlob <{surface}> ; rt:seenShare 0.25e0 ;
            rt:medianResidual 0.001e0 ; rt:residual90 0.002e0 ; rt:isWatertight true ;
            rt:reconstructionMethod "by hand" ; prov:wasDerivedFrom <urn:lab/view/1> . }}""")
        tx.add(OBJECT, ontology.NS + "name", HOSTILE)
    with running_server(folder) as running:
        yield running


def _address(server: RunningServer, name: str = OBJECT) -> str:
    return f"{server.url}/object?iri={quote(name, safe='')}"


def _drawn_once(page: Any) -> Any:
    page.get_by_text(f"{POINTS:,} points, 8.0 × 4.0 × 6.0 cm").wait_for()
    return page.locator("[data-place]")


def _times_drawn(place: Any) -> int:
    return int(place.get_attribute("data-drawn"))


@pytest.mark.skipif(not drawn.has_viewer(), reason="the 3D library needs npm at set-up")
def test_a_surface_is_drawn_and_says_that_grey_was_not_seen(
    browser_3d: Any, server: RunningServer
) -> None:
    with open_page(browser_3d, server.url) as page:
        page.goto(_address(server, SURFACED))
        page.get_by_text("4 triangles; grey: filled in, nobody saw it").wait_for()
        source = page.get_by_label("Cloud")
        assert source.locator("option").first.inner_text() == "surface of former views, 25% seen"
        assert fits(page)


@pytest.mark.skipif(not drawn.has_viewer(), reason="the 3D library needs npm at set-up")
@pytest.mark.parametrize("look", EACH_LOOK)
def test_the_cloud_turns_and_keys_select_a_grasp_in_table_and_drawing(
    browser_3d: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser_3d, server.url, **LOOKS[look]) as page:
        page.goto(_address(server))
        place = _drawn_once(page)
        assert "arrow keys select and turn" in page.locator("[data-note]").inner_text()
        assert page.title() != "1"
        before = place.screenshot()
        place.focus()
        page.keyboard.press("ArrowRight")
        page.wait_for_function("() => location.hash.includes('camera=')")
        turned = place.screenshot()
        assert turned != before
        page.keyboard.press("ArrowDown")
        rows = page.get_by_role("table", name="Grasps").locator("tbody tr")
        assert rows.nth(0).get_attribute("aria-selected") == "true"
        assert place.screenshot() != turned
        page.keyboard.press("ArrowDown")
        assert rows.nth(1).get_attribute("aria-selected") == "true"
        assert rows.nth(0).get_attribute("aria-selected") == "false"
        assert fits(page)
        keep_picture(page, f"object-{look}")
        page.reload()
        _drawn_once(page)
        page.wait_for_function(
            "() => document.querySelectorAll('tbody tr')[1].ariaSelected === 'true'"
        )


@pytest.mark.parametrize("size", SIZES)
def test_without_webgl_three_flat_views_select_and_are_selected(
    browser_2d: Any, server: RunningServer, size: str
) -> None:
    warned = ("WebGL",)
    with open_page(browser_2d, server.url, expected=warned, viewport=SIZES[size]) as page:
        page.goto(_address(server))
        place = _drawn_once(page)
        assert "Flat views" in page.locator("[data-note]").inner_text()
        before = place.screenshot()
        rows = page.get_by_role("table", name="Grasps").locator("tbody tr")
        rows.nth(2).locator("td").first.click()
        assert rows.nth(2).get_attribute("aria-selected") == "true"
        assert place.screenshot() != before
        box = place.bounding_box()
        # The stem of every gripper ends in the middle of the view from above: any may be picked.
        page.keyboard.press("Escape")
        place.click(position={"x": box["width"] / 6, "y": box["height"] / 2})
        page.wait_for_function("() => location.hash.includes('grasp=')")
        page.get_by_label("Colours").select_option("height")
        assert _times_drawn(place) > 3
        assert fits(page)


_PIXELS_OF = """(canvas, colour) => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    count += colour.every((part, at) => data[i + at] === part);
  }
  return count;
}"""
HELD, FAILED = [36, 120, 206], [196, 98, 16]


def test_a_grasp_that_always_held_is_drawn_in_the_colour_of_success(
    browser_2d: Any, server: RunningServer
) -> None:
    """Held twice of two is no failure, however small the lower bound of its chance is."""
    address = _address(server, TWICE_HELD)
    with open_page(browser_2d, server.url, expected=("WebGL",)) as page:
        page.goto(address)
        _drawn_once(page)
        canvas = page.locator("[data-place] canvas")
        assert canvas.evaluate(_PIXELS_OF, HELD) > 50
        assert canvas.evaluate(_PIXELS_OF, FAILED) == 0
        assert len(re.findall(r"[\d.]+ × [\d.]+ × [\d.]+ cm", page.inner_text("main"))) == 1
        page.goto(_address(server))  # one of its grasps failed twice of two
        _drawn_once(page)
        assert canvas.evaluate(_PIXELS_OF, FAILED) > 50


def test_the_cloud_is_thinned_by_the_server_and_kept_by_the_browser(server: RunningServer) -> None:
    address = f"{server.url}/object/cloud.ply"
    asked = {"iri": OBJECT, "view": "urn:lab/view/1", "max": "500"}
    answer = httpx.get(address, params=asked)
    assert answer.headers["content-type"] == "application/ply"
    assert b"element vertex 500\n" in answer.content
    again = httpx.get(address, params=asked, headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304
    assert httpx.get(address, params={**asked, "max": "0"}).status_code == 400
    strange = httpx.get(address, params={**asked, "view": "urn:lab/view/9"})
    assert strange.status_code == 404
    assert "not a view" in strange.json()["detail"]


def test_an_object_without_views_says_how_to_fill_its_page(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, java_script_enabled=False) as page:
        page.goto(_address(server, "urn:lab/object/2"))
        assert page.get_by_text("No view stored").count() == 1
        assert page.get_by_text("No grasp known yet").count() == 1
