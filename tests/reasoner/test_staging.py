"""Stages: nothing shows before `apply`, nothing is left after `discard`, transitions are exact."""

from __future__ import annotations

import threading

import pyoxigraph as ox
import pytest
from pyoxigraph import Literal, NamedNode

from reasoner import ChangeBudget, Closure, ClosureTooLargeError, Config, InconsistentError
from tests.reasoner.ttl import triple, triples

SCHEMA = ":Mug rdfs:subClassOf :Vessel . :Vessel owl:disjointWith :Pen ."


def build(data: str = "", config: Config | None = None) -> Closure:
    return Closure.build(triples(SCHEMA), triples(data), config=config)


def test_nothing_shows_before_apply():
    closure = build()
    staged = closure.stage(add=triples(":m a :Mug ."))
    assert staged.inferred_added == [triple(":m a :Vessel")]
    assert not closure.contains(triple(":m a :Mug"))
    assert closure.match(triple(":m a :Mug")[0]) == []
    staged.apply()
    assert closure.contains(triple(":m a :Vessel"))


def test_discard_leaves_no_trace():
    closure = build(":m a :Mug .")
    before = closure.match()
    closure.stage(
        add=triples(":n a :Mug . :Mug rdfs:subClassOf :Thing ."), remove=before[:2]
    ).discard()
    assert closure.match() == before


def test_asserting_what_was_inferred_takes_it_out_of_the_inferred_graph():
    closure = build(":m a :Mug .")
    staged = closure.stage(add=triples(":m a :Vessel ."))
    assert staged.inferred_removed == [triple(":m a :Vessel")]
    assert staged.inferred_added == []
    staged.apply()
    assert list(closure.inferred()) == []


def test_retracting_what_still_follows_puts_it_into_the_inferred_graph():
    closure = build(":m a :Mug, :Vessel .")
    staged = closure.stage(remove=triples(":m a :Vessel ."))
    assert staged.inferred_added == [triple(":m a :Vessel")]
    assert staged.inferred_removed == []


def test_adding_what_is_there_and_removing_what_is_not_changes_nothing():
    closure = build(":m a :Mug .")
    staged = closure.stage(add=triples(":m a :Mug ."), remove=triples(":x a :Mug ."))
    assert (staged.inferred_added, staged.inferred_removed) == ([], [])


def test_what_is_both_added_and_removed_is_there():
    closure = build()
    both = triples(":m a :Mug .")
    closure.stage(add=both, remove=both).apply()
    assert closure.contains(both[0])


def test_a_stage_is_used_once():
    closure = build()
    staged = closure.stage(add=triples(":m a :Mug ."))
    staged.apply()
    with pytest.raises(RuntimeError, match="already"):
        staged.apply()


def test_a_stage_does_not_survive_another_one():
    closure = build()
    late = closure.stage(add=triples(":m a :Mug ."))
    closure.stage(add=triples(":n a :Mug .")).apply()
    with pytest.raises(RuntimeError, match="another change"):
        late.apply()


def test_a_new_class_takes_effect_at_once():
    closure = build(":m a :Mug .")
    staged = closure.stage(add=triples(":Espresso rdfs:subClassOf :Mug . :e a :Espresso ."))
    assert triple(":e a :Vessel") in staged.inferred_added
    assert triple(":Espresso rdfs:subClassOf :Vessel") in staged.inferred_added


def test_only_new_contradictions_are_listed_with_a_stage():
    closure = build(":m a :Mug, :Pen .")
    assert len(closure.contradictions()) == 1
    assert closure.stage(add=triples(":n a :Mug .")).contradictions == []
    (clash,) = closure.stage(add=triples(":n a :Mug, :Pen .")).contradictions
    assert clash.rule == "cax-dw"
    assert set(clash.triples) == set(triples(":n a :Vessel, :Pen ."))
    assert clash.axioms == (triple(":Vessel owl:disjointWith :Pen"),)
    assert "cax-dw" in str(clash)


def test_a_contradiction_can_be_refused_at_once():
    closure = build(config=Config(on_contradiction="reject"))
    with pytest.raises(InconsistentError, match="disjoint") as caught:
        closure.stage(add=triples(":n a :Mug, :Pen ."))
    assert len(caught.value.contradictions) == 1
    assert not closure.contains(triple(":n a :Mug"))


def test_nothing_is_derived_from_a_contradiction():
    closure = build(":m a :Mug, :Pen .")
    assert not closure.contains(triple(":m a owl:Nothing"))


def test_ill_typed_literals_are_contradictions_or_kept():
    bad = [(NamedNode("urn:t:a"), NamedNode("urn:t:p"), _integer("abc"))]
    (clash,) = build().stage(add=bad).contradictions
    assert clash.rule == "dt-not-type"
    kept = build(config=Config(ill_typed="keep"))
    assert kept.stage(add=bad).contradictions == []


def _integer(text: str) -> Literal:
    return Literal(text, datatype=NamedNode("http://www.w3.org/2001/XMLSchema#integer"))


@pytest.mark.parametrize("batch", [1, 2, 100_000])
def test_triple_terms_and_their_reifiers_are_no_input(batch, monkeypatch):
    monkeypatch.setattr("reasoner.closure._BATCH", batch)
    a, p = NamedNode("urn:t:a"), NamedNode("urn:t:p")
    reifies = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#reifies")
    reifier = NamedNode("urn:t:r")
    statements = [
        (reifier, p, Literal(0.9)),
        (a, p, a),
        (reifier, reifies, ox.Triple(a, p, a)),
    ]
    closure = Closure.build(triples(":p rdfs:domain :C ."), statements)
    assert list(closure.inferred()) == [triple(":a a :C")]
    assert closure.stats()["skipped"] == 2


def test_an_explosion_is_stopped_and_the_stage_gone():
    closure = Closure.build(
        triples(":p a owl:TransitiveProperty, owl:SymmetricProperty ."),
        [],
        config=Config(max_inferred=100),
    )
    ring = triples(" ".join(f":n{i} :p :n{i + 1} ." for i in range(80)))
    with pytest.raises(ClosureTooLargeError, match="urn:t:p"):
        closure.stage(add=ring)
    assert (
        closure.match() == triples(":p a owl:TransitiveProperty, owl:SymmetricProperty .")
        or len(closure.match()) == 2
    )


def test_large_classes_of_equal_terms_are_exported_as_a_star():
    data = " ".join(f":n{i} owl:sameAs :n{i + 1} ." for i in range(19)) + " :n5 :p :x ."
    closure = Closure.build([], triples(data))
    exported = list(closure.inferred())
    assert len(exported) < 20 + 19
    assert closure.contains(triple(":n19 :p :x"))
    assert len(closure.same_as(NamedNode("urn:t:n7"))) == 20


def test_a_large_change_is_derived_in_one_go_with_the_same_result():
    rows = " ".join(f":m{i} a :Mug ." for i in range(60))
    small, large = build(), build(config=Config(bulk_from=50))
    changes = [c.stage(add=triples(rows)) for c in (small, large)]
    assert set(changes[0].inferred_added) == set(changes[1].inferred_added)
    for change in changes:
        change.apply()
    back = [c.stage(remove=triples(rows)) for c in (small, large)]
    assert set(back[0].inferred_removed) == set(back[1].inferred_removed)
    assert len(back[0].inferred_removed) == 60


def test_the_digest_follows_the_inferred_graph():
    closure = build()
    empty = closure.digest()
    staged = closure.stage(add=triples(":m a :Mug ."))
    kept = build(":m a :Mug .").digest()
    staged.apply()
    assert closure.digest() == kept != empty
    empty.add(staged.inferred_added)
    assert empty == kept


def test_readers_need_no_lock():
    closure = build(" ".join(f":m{i} a :Mug ." for i in range(200)))
    vessels = triple(":m1 a :Vessel")
    failures: list[BaseException] = []
    done = threading.Event()

    def read() -> None:
        try:
            while not done.is_set():
                assert closure.contains(vessels)
                assert len(closure.match(None, *vessels[1:])) >= 200
                assert closure.explain(vessels).holds
        except BaseException as error:  # noqa: BLE001 - whatever it was, the test fails with it
            failures.append(error)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    for i in range(60):
        closure.stage(add=triples(f":new{i} a :Mug ; :near :m{i} .")).apply()
    done.set()
    for reader in readers:
        reader.join()
    assert not failures


def test_configuration_is_checked():
    with pytest.raises(ValueError, match="'report' or 'reject'"):
        Config(on_contradiction="ignore")
    with pytest.raises(ValueError, match="'reject' or 'keep'"):
        Config(ill_typed="drop")


def test_a_refused_change_leaves_no_terms_behind_and_their_values_can_be_met_anew():
    closure = build(":m a :Mug ; :size 1 .")
    before = closure.stats()["terms"]
    closure.stage(add=triples(":new :size 2, 2.0, 1.0 . :p :part :q .")).discard()
    assert closure.stats()["terms"] == before
    budget = ChangeBudget(derived=0, firings=10)
    with pytest.raises(ClosureTooLargeError):
        closure.stage(add=triples(":other a :Mug ; :size 2, 1.0 ."), budget=budget)
    assert closure.stats()["terms"] == before
    assert not closure.contains(triple(":m :size 2"))
    closure.stage(add=triples(":z a :Mug ; :size 2.0 . :n :size 3, 1.0 .")).apply()
    assert closure.contains(triple(":z a :Vessel"))
    assert closure.contains(triple(":z :size 2"))  # by value
    assert closure.contains(triple(":n :size 1"))
    assert not closure.contains(triple(":m :size 2"))


def test_terms_of_a_discarded_change_stay_while_a_later_change_has_others():
    closure = build()
    first = closure.stage(add=triples(":a1 a :Mug ."))
    later = closure.stage(add=triples(":a2 a :Mug ."))
    first.discard()
    later.apply()
    assert closure.contains(triple(":a2 a :Vessel"))
    assert not closure.contains(triple(":a1 a :Vessel"))
