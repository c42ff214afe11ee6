"""Objects that are stored as new although they may be known: the answer and the graph say so."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from features.recognition.recogniser import Match, Recognition
from rtask.engine.curation import twins
from rtask.engine.perception.identity import settle
from rtask.engine.policy import Policy
from rtask.engine.records import prepared
from rtask.rdf.namespaces import PREFIXES, RDF, RT
from rtask.rdf.terms import Triple, iri

_LIKE = f"""{PREFIXES} SELECT ?one ?other ?sure WHERE {{
  ?said rdf:reifies <<( ?one rt:similarTo ?other )>> ; rt:confidence ?sure }}"""


@pytest.fixture
def doubt(monkeypatch):
    """Return a function after which insertions are no longer sure of what they recognise."""
    recognise = prepared.recognise

    def doubtful(*args, **more):
        found = recognise(*args, **more)
        matches = tuple(replace(match, confidence=0.6) for match in found.matches)
        return replace(found, accepted=False, matches=matches, ask_again=bool(matches))

    return lambda: monkeypatch.setattr(prepared, "recognise", doubtful)


@pytest.fixture
def resembling(bench, robots, doubt):
    """Return a robot and its two insertions of one product, of which the second was in doubt."""
    robot = robots()
    robot.insert(bench.sight(bench.CAN))
    (first,) = robot.insert(bench.sight(bench.BOX), name="tea")["objects"]
    doubt()
    (second,) = robot.insert(bench.sight(bench.BOX, bench.Eye(noise_seed=1)))["objects"]
    return robot, first, second


def test_an_insertion_in_doubt_says_what_the_new_object_may_be(kb, resembling):
    _, first, second = resembling
    assert "resembles" not in first
    assert second["new"]
    assert second["resembles"] == {
        "object": first["object"], "label": "tea", "confidence": pytest.approx(0.6),
    }  # fmt: skip
    assert "may be tea (0.60)" in second["message"]
    (row,) = kb.select(_LIKE)
    assert (row.value("one"), row.value("other")) == (second["object"], first["object"])
    assert row.value("sure") == pytest.approx(0.6)


def test_an_insertion_that_asks_for_a_new_object_is_in_no_doubt(bench, robots, doubt):
    robot = robots()
    robot.insert(bench.sight(bench.BOX))
    doubt()
    (second,) = robot.insert(bench.sight(bench.BOX), merge=False)["objects"]
    assert second["new"]
    assert "resembles" not in second


@pytest.mark.parametrize("is_first_kept", [True, False])
def test_one_object_is_not_like_itself_after_the_merge(kb, resembling, is_first_kept):
    robot, *both = resembling
    kept, other = (one["object"] for one in (both if is_first_kept else both[::-1]))
    before = set(map(str, kb.select(_LIKE)))
    merge = {"operation": "merge", "object": other, "into": kept, "operator": "anna"}
    done = robot.engine.call("curate_object", merge)
    assert not kb.match(None, RT.similarTo)
    assert not [q for q in kb.match(None, RDF.reifies) if _is_likeness(q.object)]
    undo = {"operation": "undo", "commit": done["commit"], "operator": "anna"}
    robot.engine.call("curate_object", undo)
    assert set(map(str, kb.select(_LIKE))) == before


def _is_likeness(said):
    return isinstance(said, Triple) and said.predicate == RT.similarTo


def test_of_two_that_were_in_doubt_it_is_enough_that_one_is_recognised(
    kb, resembling, monkeypatch
) -> None:
    _, first, second = (one if k == 0 else one["object"] for k, one in enumerate(resembling))

    def only_the_second(index, recogniser, views, *args):
        return {first: 0.8} if views[0][0].object == second else {}

    monkeypatch.setattr(twins, "_recognised_without", only_the_second)
    assert twins.find_twins(kb) == [twins.Twins(first, second, 0.8)]
    with kb.transaction() as tx:
        tx.remove(iri(second), RT.similarTo, iri(first))
    monkeypatch.setattr(twins, "_alike", lambda kb: set())
    assert twins.find_twins(kb) == []


def test_views_beyond_the_limit_are_counted_as_untried(kb, monkeypatch) -> None:
    views = [SimpleNamespace(object=name) for name in ("urn:o:1",) * 5 + ("urn:o:2",) * 2]
    monkeypatch.setattr(twins, "stored_views", lambda kb: views)
    assert [twins.count_untried(kb, most) for most in (1, 4, 5)] == [5, 1, 0]


def test_a_likeness_that_the_size_rules_out_calls_for_no_other_view() -> None:
    match = Match("o:1", "c:box", 0.6, 9, (), 0.9, None, None, "v:1")
    doubtful = Recognition("single", False, (match,), ask_again=True)
    left = settle(doubtful, SimpleNamespace(objects={}), None, Policy())
    assert left.matches == ()
    assert not left.ask_again
