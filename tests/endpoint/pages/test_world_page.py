"""The page of the world: a list that needs no script, its twin, and files for other programs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from flask.testing import FlaskClient

from tests.endpoint.sites import HOST, Site
from tests.rtask.world.conftest import _LAB, Lab

pytestmark = pytest.mark.slow
NOTHING = "INSERT DATA { <urn:x> <urn:p> 1 }"
AT = "2025-11-28T12:01:00Z"


@pytest.fixture(scope="module")
def ann() -> Iterator[FlaskClient]:
    with Site.opened(NOTHING) as site:
        site.kb.update(_LAB)
        lab = Lab(site.kb)
        lab.stand(lab.table, lab.map, 2.0, 0.0, 0.0)
        lab.see(lab.cup, 0.3, 0.3, 10.0, frame=lab.table)
        lab.put(lab.see(lab.box, 0.3, -0.1, 10.0), "in", lab.left_box, 20.0)
        yield site.signed_in("ann")


def read(browser: FlaskClient, address: str, **query: str) -> str:
    answer = browser.get(
        address, query_string=query, base_url=HOST, headers={"Accept": "text/html"}
    )
    assert answer.status_code == 200
    return answer.text


def test_the_page_lists_what_was_where_and_what_nobody_knows(ann: FlaskClient) -> None:
    shown = read(ann, "/world", at=AT)
    assert "2.300, 0.300, 0.000" in shown
    assert "1 thing, 0 robots in the frame map" in shown
    assert "in left box, whose pose is not known" in shown
    assert 'href="/world/scene.glb?at=2025-11-28T12%3A01%3A00Z"' in shown
    assert "Nothing was known to be here" in read(ann, "/world", at="2025-11-28T11:00:00Z")


def test_the_twin_names_the_changes_before_and_after(ann: FlaskClient) -> None:
    model = ann.get("/world.json", query_string={"at": AT}, base_url=HOST).json
    assert model
    assert model["span"]["before"] == "2025-11-28T12:00:20.000Z"
    assert model["span"]["after"] is None
    (cup,) = (node for node in model["scene"]["nodes"] if node["kind"] == "thing")
    assert [row[3] for row in cup["pose"]] == [2.3, 0.3, 0.0, 1.0]
    # The instant itself is after the change: the box is then in the other one.
    then = ann.get("/world.json", query_string={"at": model["span"]["before"]}, base_url=HOST).json
    assert then
    assert [one["label"] for one in then["scene"]["unplaced"]] == ["tea box"]


def test_files_come_with_their_types_and_wrong_questions_are_answered(ann: FlaskClient) -> None:
    glb = ann.get("/world/scene.glb", query_string={"at": AT}, base_url=HOST)
    assert (glb.content_type, glb.data[:4]) == ("model/gltf-binary", b"glTF")
    usda = ann.get("/world/scene.usda", query_string={"at": AT}, base_url=HOST)
    assert (usda.content_type.partition(";")[0], usda.data[:5]) == ("model/vnd.usda", b"#usda")
    for address, query, status in (
        ("/world/scene.obj", {}, 400), ("/world/scene.glb", {"at": "noon"}, 400),
        ("/world/scene.glb", {"at": "1e300"}, 400), ("/world/scene.usda", {"frame": "attic"}, 422),
    ):  # fmt: skip
        assert ann.get(address, query_string=query, base_url=HOST).status_code == status
    assert "is not a time" in read(ann, "/world", at="noon")
    assert "expected a time from 1970" in read(ann, "/world", at="1e300")
    assert "no frame &#39;attic&#39;" in read(ann, "/world", frame="attic")
    assert "expected a time" in read(ann, "/world", at="nan")
