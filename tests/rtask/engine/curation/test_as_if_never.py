"""A contributor who is withdrawn leaves the store as it was before it told anything."""

from __future__ import annotations

import pytest

import rtask
from rtask.rdf.namespaces import RT
from tests.rtask.engine.curation.test_withdrawing import ANN, newest, report, withdraw

pytestmark = [pytest.mark.slow, pytest.mark.deep]


@pytest.fixture
def kb():
    """Return a store with the rules, so that reach and verdicts follow."""
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


def content(engine):
    """Return all statements, also derived ones, but those about commits and their authors."""
    graphs = engine.kb.graphs
    return {quad for quad in engine.kb.match()
            if quad.graph_name not in (graphs.meta, graphs.provenance)}  # fmt: skip


def test_what_it_told_and_what_followed_is_gone_statement_for_statement(bench, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    thing = one.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    grasp = report(one, thing, bench.held())["grasp"]
    report(one, thing, bench.missed())
    before, alone = content(engine), newest(engine, grasp)
    for outcome in (bench.held(), bench.missed(), bench.missed()):
        report(two, thing, outcome)
    other = two.insert(bench.sight(bench.CAN))["objects"][0]["object"]
    report(two, other, bench.held())
    pose = {"position": dict.fromkeys("xyz", 0.2), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    seen = [{"object": thing, "pose": pose}]
    two.call("report_sightings", frame="base_footprint", seen=seen)
    engine.call("give_feedback", {"object": other, "verdict": "refuse"}, ANN)
    told = content(engine)
    commit = withdraw(engine, "nao-2")["commit"]
    after = content(engine)
    # The belief that counted nao-2 is made anew by whoever withdrew it; she is known from then on.
    left = {quad for quad in after - before if not about(quad, "/evaluation/ann", "/person/ann")}
    gone = {quad for quad in before - after if not about(quad, "/evaluation/nao-1")}
    assert (left, gone) == (set(), set())
    assert newest(engine, grasp) == pytest.approx(alone)
    assert not engine.kb.match(None, RT.performedBy, engine.kb.graphs.agent_iri("nao-2"))
    engine.call("curate_object", {"operation": "undo", "commit": commit}, ANN)
    assert content(engine) == told


def about(quad, *ends: str) -> bool:
    """Tell whether a statement is about a node, or names it."""
    return str(quad.subject)[:-1].endswith(ends) or str(quad.object)[:-1].endswith(ends)
