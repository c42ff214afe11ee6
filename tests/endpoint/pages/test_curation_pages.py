"""Pages on which people name, merge, split and forget objects; and who may not."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from flask.testing import FlaskClient

import ontology
from endpoint.pages.curation import Alike
from tests.endpoint.sites import HOST, Site

pytestmark = pytest.mark.slow

HTML = {"Accept": "text/html"}
HOSTILE = "<img src=x onerror=alert(1)>"
FACTS = f"""
PREFIX rt: <{ontology.NS}> PREFIX prov: <{ontology.PREFIXES["prov"]}>
PREFIX rdf: <{ontology.PREFIXES["rdf"]}>
INSERT DATA {{
  <urn:lab/object/1> a rt:ManipulableObject, rt:Mug ; rt:objectId "lab/1" ; rt:name "blue mug" ;
    rt:hasView <urn:lab/view/1>, <urn:lab/view/2> ; rt:hasGrasp <urn:lab/grasp/1> .
  <urn:lab/object/2> a rt:ManipulableObject, rt:Box ; rt:objectId "lab/2" ; rt:name "{HOSTILE}" ;
    rt:hasView <urn:lab/view/3> .
  <urn:lab/statement/1> rdf:reifies <<( <urn:lab/object/2> a rt:Box )>> ; rt:confidence 0.6e0 .
  <urn:lab/object/3> a rt:ManipulableObject, rt:Can ; rt:objectId "lab/3" ; rt:name "atlas" .
  <urn:lab/view/1> a rt:View . <urn:lab/view/2> a rt:View . <urn:lab/view/3> a rt:View .
  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" .
}}"""


@pytest.fixture
def site() -> Iterator[Site]:
    with Site.opened(FACTS) as opened:
        yield opened


def page(browser: FlaskClient, address: str, status: int = 200) -> str:
    answer = browser.get(address, base_url=HOST, headers=HTML)
    assert answer.status_code == status, answer.text
    assert "<img src=x" not in answer.text
    return str(answer.text)


def send(browser: FlaskClient, address: str, origin: str | None = HOST, **form: Any) -> Any:
    """Send a form as the page made it for this session."""
    forms = page(browser, "/object/forget?iri=urn:lab/object/1")
    found = re.search(r'name="secret" value="([^"]+)"', forms)
    form = {"secret": found.group(1) if found else "", **form}
    headers = {"Origin": origin} if origin else {}
    return browser.post(address, data=form, base_url=HOST, headers=headers)


def curate(browser: FlaskClient, operation: str, **form: Any) -> Any:
    return send(browser, "/object/curate", operation=operation, **form)


def commit_of(answer: Any) -> str:
    found = re.search(r"done=(c-\d+)", answer.headers["Location"])
    assert found
    return found.group(1)


def test_an_object_is_found_compared_merged_and_taken_back(site: Site) -> None:
    ann = site.signed_in("ann")
    shown = page(ann, "/object?iri=urn:lab/object/2")
    assert "/object/merge?iri=urn%3Alab%2Fobject%2F2" in shown
    found = page(ann, "/object/merge?iri=urn:lab/object/2&find=MUG blue")
    assert "blue mug" in found
    assert "atlas" not in found
    both = page(ann, "/object/merge?iri=urn:lab/object/2&into=urn:lab/object/1")
    assert "It will have 3 views, 1 grasp, 0 attempts." in " ".join(both.split())
    assert "They are of different kinds" in both
    done = curate(ann, "merge", object="urn:lab/object/2", into="urn:lab/object/1")
    assert done.status_code == 303
    # The old address leads to what it is now, and the change is listed with its author.
    now = ann.get("/object.json?iri=urn:lab/object/2", base_url=HOST).get_json()
    assert (now["iri"], len(now["views"])) == ("urn:lab/object/1", 3)
    (change,) = ann.get("/curation.json", base_url=HOST).get_json()["changes"]
    assert (change["by"], change["commit"]) == ("ann", commit_of(done))
    back = curate(ann, "undo", commit=commit_of(done))
    assert back.headers["Location"].endswith("/curation")
    newest, oldest = ann.get("/curation.json", base_url=HOST).get_json()["changes"]
    assert (newest["taken_back"], oldest["taken_back"]) == (False, True)
    assert "taken back" in page(ann, "/curation")
    again = curate(ann, "undo", commit=commit_of(done))
    assert again.status_code == 409
    assert "already" in again.text


def test_views_are_split_off_or_forgotten(site: Site) -> None:
    boss = site.signed_in("boss")
    shown = page(boss, "/object/split?iri=urn:lab/object/1")
    assert shown.count('name="views"') == 2
    done = curate(boss, "split", object="urn:lab/object/1", views=["urn:lab/view/2"],
                  name="white mug", operator="cleo")  # fmt: skip
    assert done.status_code == 303
    assert "by=cleo" in done.headers["Location"]
    assert "white mug" in page(boss, done.headers["Location"])
    assert "one view only" in page(boss, "/object/split?iri=urn:lab/object/1")
    for form, words in (
        ({"views": ["urn:lab/view/1"]}, "at least one view of the object must stay"),
        ({}, "views is missing"),
        ({"views": ["urn:lab/view/3"]}, "is not a view of"),
    ):
        refused = curate(boss, "split", object="urn:lab/object/1", **form)
        assert refused.status_code in (400, 422)
        assert words in refused.text


def test_a_forgotten_object_is_gone_and_says_so(site: Site) -> None:
    ann = site.signed_in("ann")
    done = curate(ann, "forget", object="urn:lab/object/3")
    assert done.headers["Location"].startswith("/curation?done=")
    text = page(ann, done.headers["Location"])
    assert "Take it back" in text
    assert "was forgotten" in page(ann, "/object?iri=urn:lab/object/3", 410)
    assert "atlas" not in page(ann, "/objects")
    assert curate(ann, "undo", commit=commit_of(done)).status_code == 303
    assert "atlas" in page(ann, "/objects")


def test_an_unnamed_object_is_listed_named_and_leaves_the_list(site: Site) -> None:
    ann = site.signed_in("ann")
    model = ann.get("/teach.json", base_url=HOST).get_json()
    assert [one["object"] for one in model["unnamed"]] == ["urn:lab/object/2"]
    asked = "/teach.json?iri=urn:lab/object/2&name=blue&description=mug"
    model = ann.get(asked, base_url=HOST).get_json()
    assert [one["object"] for one in model["candidates"]] == ["urn:lab/object/1"]
    assert model["is_known_kind"]
    model = ann.get("/teach.json?iri=urn:lab/object/2&description=mugg", base_url=HOST).get_json()
    assert "mug" in model["suggestions"]
    assert "of the new kind “mugg”" in page(ann, "/teach?iri=urn:lab/object/2&description=mugg")
    named = send(ann, "/teach", object="urn:lab/object/2", name="red one", class_description="mug")
    assert named.status_code == 303
    now = ann.get("/object.json?iri=urn:lab/object/2", base_url=HOST).get_json()
    assert now["name"] == "red one"
    assert "mug" in now["classes"]
    assert ann.get("/teach.json", base_url=HOST).get_json()["unnamed"] == []
    assert send(ann, "/teach", object="urn:lab/object/2").status_code in (400, 422)


def test_neither_robots_nor_foreign_pages_nor_strangers_change_objects(site: Site) -> None:
    robot, ann = site.signed_in("nao-1"), site.signed_in("ann")
    seq = site.kb.seq
    assert "sign in" in page(robot, "/object/forget?iri=urn:lab/object/3")
    assert 'value="merge"' not in page(
        robot, "/object/merge?iri=urn:lab/object/2&into=urn:lab/object/1"
    )
    merge = {"object": "urn:lab/object/2", "into": "urn:lab/object/1", "operation": "merge"}
    assert send(robot, "/object/curate", **merge).status_code == 403
    assert send(robot, "/teach", object="urn:lab/object/2", name="mine").status_code == 403
    assert send(ann, "/object/curate", origin="https://evil.example", **merge).status_code == 403
    assert send(ann, "/object/curate", origin=None, **merge).status_code == 403
    assert send(ann, "/object/curate", secret="another", **merge).status_code == 403
    assert send(ann, "/object/curate", operator="bob", **merge).status_code == 403
    stranger = site.app.test_client()
    assert stranger.post("/object/curate", data=merge, base_url=HOST).status_code == 401
    assert site.kb.seq == seq


@pytest.mark.parametrize(
    ("address", "status"),
    [
        ("/object/merge", 400),
        ("/object/merge?iri=urn:lab/object/9", 404),
        ("/object/merge?iri=urn:lab/object/1&into=urn:lab/object/1", 422),
        ("/object/split?iri=not an iri", 422),
        ("/teach?iri=", 400),
        ("/objcts", 404),
    ],
)
def test_a_wrong_address_says_what_is_wrong(site: Site, address: str, status: int) -> None:
    assert 'class="problem"' in page(site.signed_in("ann"), address, status)


def test_an_unknown_operation_gets_the_nearest_name(site: Site) -> None:
    refused = curate(site.signed_in("ann"), "mrege", object="urn:lab/object/1")
    assert "did you mean 'merge'?" in refused.get_json()["detail"]


def test_views_that_were_not_compared_leave_it_undecided_what_an_object_is(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    browser = site.signed_in("ann")
    address = "/teach?iri=urn:lab/object/3"
    assert "Not decided: it has no view that can be compared" in page(browser, address)
    monkeypatch.setattr("endpoint.pages.teach.objects_alike", lambda *_: Alike(views_untried=7))
    assert "Not decided: 7 stored views" in page(browser, address)
    monkeypatch.setattr("endpoint.pages.teach.MAX_CANDIDATES", 1)
    assert "data-left-out" in page(browser, address + "&name=a")


def test_words_too_many_to_look_for_are_refused_and_not_cut(site: Site) -> None:
    browser = site.signed_in("ann")
    assert "mug" in page(browser, "/search?q=mug")
    assert "at most 200" in page(browser, "/search?q=" + "mug+" * 60 + "nothing", status=400)
