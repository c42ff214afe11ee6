"""Things are made of what robots reported in a graph that is older than things."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import ontology
import rtask
from rtask.cli.world.migrate import migrate
from rtask.engine.curation import older_graphs
from rtask.errors import ConflictError
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, iri

BASE = "https://example.org/kb/"
CUP, TEA = f"{BASE}object/1", f"{BASE}object/2"


def _seen(robot: str, product: str, k: str, x: float, clock: str, moved: str = "") -> str:
    frame = f"<{BASE}robot/{robot}/frame/base>"
    over = f'<urn:e{k}> prov:invalidatedAtTime "2025-11-28T{moved}Z"^^xsd:dateTime .'
    return f"""
  <urn:e{k}> a rt:PoseEstimate ; rt:poseOf <{product}> ; rt:estimatedPose <urn:p{k}> ;
    rt:poseConfidence 0.9e0 ; prov:wasAttributedTo <{BASE}robot/{robot}> .
  {frame} a rt:Frame ; rt:frameId "base" .
  <urn:p{k}> a rt:Pose ; rt:inFrame {frame} ; rt:x {x}e0 ; rt:y 0.1e0 ; rt:z 0.0e0 ;
    rt:qx 0.0e0 ; rt:qy 0.0e0 ; rt:qz 0.0e0 ; rt:qw 1.0e0 ;
    rt:atTime "2025-11-28T{clock}Z"^^xsd:dateTimeStamp . {over if moved else ""}"""


def _tried(robot: str, product: str, k: str, clock: str, end: str, place: str = "") -> str:
    """Return an attempt as robots reported it, and where they said that it left the product."""
    where = f"<{BASE}robot/{robot}/place/box>"
    put = f"""
  <urn:t{k}/place> a rt:Place ; rt:handles <{product}> ; rt:carriedOutBy <urn:a{k}> ;
    rt:targetSurface {where} .
  {where} a rt:SupportSurface ; rt:name "{place}" . <{product}> rt:locatedOn {where} ."""
    return f"""
  <urn:t{k}> a rt:Grasp ; rt:handles <{product}> ; rt:through <urn:a{k}> .
  <urn:a{k}> a rt:GraspAttempt ; rt:performedBy <{BASE}robot/{robot}> ; rt:hasOutcome <urn:o{k}> ;
    rt:activates <{BASE}robot/{robot}/hand> ;
    prov:endedAtTime "2025-11-28T{clock}Z"^^xsd:dateTime .
  <urn:o{k}> a rt:GraspOutcome ; {end} .{put if place else ""}"""


_PLACED = "rt:success true ; rt:placed true ; rt:hasReason rt:reason_ok"
_LET_GO = "rt:success true ; rt:hasReason rt:reason_ok"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a graph of two robots that each put a cup into a box; one saw a tea box as well."""
    shared = f"""
  <{CUP}> a rt:Mug ; rt:objectId "lab/1" ; rt:name "cup" ; rt:extentX 0.09e0 .
  <{TEA}> a rt:Box ; rt:objectId "lab/2" ; rt:name "tea" .
  <{BASE}robot/nao-1> a cora:Robot ; rt:name "nao-1" .
  <{BASE}robot/nao-2> a cora:Robot ; rt:name "nao-2" ."""
    one = (
        _seen("nao-1", CUP, "1", 0.3, "10:00:00", "10:01:00")
        + _tried("nao-1", CUP, "1", "10:01:00", _PLACED, "left box")
        + _seen("nao-1", CUP, "2", 0.4, "10:02:00")
    )
    two = (
        _seen("nao-2", CUP, "3", 0.3, "11:00:00", "11:01:00")
        + _tried("nao-2", CUP, "3", "11:01:00", _PLACED, "left box")
        + _seen("nao-2", TEA, "4", 0.5, "11:02:00", "11:03:00")
        + _tried("nao-2", TEA, "4", "11:03:00", _LET_GO)
    )
    with rtask.open(tmp_path / "store", base=BASE) as kb:
        for graph, text in (("shared", shared), ("agent/nao-1", one), ("agent/nao-2", two)):
            kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/{graph}> {{ {text} }} }}")
    return tmp_path / "store"


def _answers(kb):
    paths = (*ontology.queries(), *ontology.episode_queries())
    texts = {path.stem: path.read_text("utf-8") for path in paths}
    return {name: sorted(map(str, kb.query(text))) for name, text in texts.items()}


def _asserted(kb):
    system = (kb.graphs.inferred, kb.graphs.meta, kb.graphs.provenance)
    return {quad for quad in kb.match() if quad.graph_name not in system}


def test_each_robot_has_things_of_its_own_with_one_place_each_and_it_can_be_undone(folder):
    with rtask.open(folder) as kb:
        before, answers = _asserted(kb), _answers(kb)
        assert len(kb.match(iri(CUP), RT.locatedOn)) == 2, "one product in two boxes"
    done = CliRunner().invoke(migrate, ["--data", str(folder)])
    assert done.exit_code == 0, done.output
    assert "2 products have 4 things" in done.output
    with rtask.open(folder) as kb:
        places = kb.world.where_is("cup").exemplars
        assert sorted(place.relation for place in places) == ["at", "in", "in"]
        for place in places:
            assert len(kb.match(iri(place.exemplar), RT.currentPlacement)) == 1
        assert not kb.match(iri(CUP), RT.locatedOn), "a product is nowhere"
        assert not kb.world.where_is("tea").is_known, "the graph does not say that it is held"
        owners = {quad.graph_name for quad in kb.match(None, RT.placementOf)}
        assert owners - {kb.graphs.inferred} == {kb.graphs.agent("nao-1"), kb.graphs.agent("nao-2")}
        now = _answers(kb)
        # Things have the kinds of their products, and are counted beside them.
        assert {name for name in now if now[name] != answers[name]} == {
            "cq24",
            "cq26",
            "cq30",
            "eq22",
            "eq29",
        }
        assert {*answers["cq24"]} < {*now["cq24"]}, "things are for drinking as their products are"
        assert len(now["eq22"]) == 3
        assert older_graphs.migrate(kb).products == 0
    undone = CliRunner().invoke(migrate, ["--undo", "--json", "--data", str(folder)])
    assert undone.exit_code == 0, undone.output
    assert len(json.loads(undone.stdout)["undone"]) == 2
    with rtask.open(folder) as kb:
        assert _asserted(kb) == before
        assert _answers(kb) == answers


def test_a_run_that_was_killed_goes_on_and_what_is_written_since_forbids_the_undoing(
    folder, monkeypatch
):
    class Killed(Exception):
        pass

    def die(product: str) -> None:
        raise Killed

    with rtask.open(folder) as kb:
        with pytest.raises(Killed):
            older_graphs.migrate(kb, on_product=die)
        assert older_graphs.migrate(kb).products == 1
        assert {str(quad.object.value) for quad in kb.match(None, RT.exemplarOf)} == {CUP, TEA}
        with kb.transaction("nao-1") as tx:
            tx.add(NamedNode(CUP), RT.mass, 0.2)
        with pytest.raises(ConflictError, match="is not of a migration"):
            older_graphs.undo_migration(kb)
