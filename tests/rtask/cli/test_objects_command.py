"""``rtask objects``: what is known, and objects called by their names."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli import main

_KNOWN = f"""
PREFIX rt: <{ontology.NS}>
INSERT DATA {{
  <urn:o:1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue mug" ; rt:hasView <urn:v:1>, <urn:v:2> .
  <urn:o:2> a rt:ManipulableObject ; rt:objectId "lab/2" ; rt:name "a thing" .
  <urn:o:3> a rt:ManipulableObject ; rt:objectId "lab/3" ; rt:name "tea" ; rt:hasGrasp <urn:g:1> .
  <urn:o:4> a rt:ManipulableObject ; rt:objectId "lab/4" ; rt:name "tea" .
}}"""
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    with rtask.open(tmp_path / "kb", base="urn:lab/") as kb:
        kb.update(_KNOWN, "nao-1")

    def call(*arguments: str, data: str = "kb") -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as caught:
            main(["objects", *arguments, "--data", str(tmp_path / data)])
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return call


def test_the_list_counts_views_and_grasps(run: Run) -> None:
    code, out, _ = run("list", "--json")
    assert code == 0
    rows = {row["object"]: row for row in json.loads(out)}
    assert list(rows) == ["urn:o:2", "urn:o:1", "urn:o:3", "urn:o:4"]  # by name
    assert (rows["urn:o:1"]["kind"], rows["urn:o:1"]["views"]) == ("mug", 2)
    assert (rows["urn:o:3"]["kind"], rows["urn:o:3"]["grasps"]) == (None, 1)
    assert "2 views     0 grasps  blue mug (mug)  urn:o:1" in run("list")[1]


def test_an_empty_list_says_so(run: Run, tmp_path: Path) -> None:
    rtask.open(tmp_path / "empty").close()
    code, out, err = run("list", data="empty")
    assert (code, out) == (1, "")
    assert "no objects yet" in err
    code, out, err = run("twins", data="empty")
    assert (code, out) == (0, "")
    assert "no twins" in err


def test_twins_are_not_decided_while_views_are_untried(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rtask.engine.curation import twins

    monkeypatch.setattr(twins, "find_twins", lambda kb, views: [])
    monkeypatch.setattr(twins, "count_untried", lambda kb, views: 3)
    code, out, err = run("twins", "--views", "2")
    assert (code, out) == (0, "")
    assert "not decided, 3 views were not tried" in err
    assert "--views 4" in err
    assert "no twins" not in err
    assert json.loads(run("twins", "--json")[1])["views_untried"] == 3


def test_an_object_is_called_by_its_name(run: Run) -> None:
    assert json.loads(run("show", "blue mug", "--json")[1])["object"] == "urn:o:1"
    code, out, err = run("name", "a thing", "--as", "a lid", "--agent", "ann")
    assert code == 0, err
    assert "a lid urn:o:2" in out
    assert "lid" in run("show", "a lid")[1]


def test_an_iri_still_names_it(run: Run) -> None:
    assert json.loads(run("show", "urn:o:4", "--json")[1])["names"] == ["tea"]
    code, _, err = run("show", "urn:o:99")
    assert code == 1
    assert "no object urn:o:99" in err
    code, _, err = run("show", "urn:v:1")
    assert code == 1
    assert "urn:v:1 is in the graph, but no object: its kind is view" in err


def test_a_name_of_two_objects_asks_for_the_iri(run: Run) -> None:
    code, _, err = run("merge", "tea", "blue mug")
    assert code == 2
    assert "2 objects are called 'tea'; give the IRI: urn:o:3, urn:o:4" in err


def test_a_name_that_is_near_is_suggested(run: Run) -> None:
    code, _, err = run("forget", "blue mugg")
    assert code == 1
    assert "no object is called 'blue mugg'; did you mean 'blue mug'?" in err
    assert "rtask objects list" in run("show", "zebra")[2]
