"""What a copy of a closure derived is adopted by the original, whatever that took meanwhile."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import HealthCheck, given, settings
from pyoxigraph import NamedNode

from reasoner import ChangeBudget, Closure, Follower
from reasoner.handover import MAX_STEP
from tests.reasoner.test_closure_properties import IN_BULK, RULES, clashes
from tests.reasoner.ttl import triples
from tests.reasoner.worlds import NARROW, WIDE

SOME = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
EXAMPLES = [20, pytest.param(300, marks=pytest.mark.deep)]


def never() -> None:
    """Let the work go on."""


def copy_of(closure: Closure, rules=()) -> Closure:
    """Return a copy with the same ids, as a forked process has it."""
    return Closure.from_image(closure.image(), rules)


def edited(asserted: set, add, picks) -> tuple[set, set]:
    """Return what an edit adds to and removes from a set of triples."""
    ordered = sorted(asserted, key=str)
    remove = {ordered[i % len(ordered)] for i in picks if ordered} - set(add)
    return set(add) - asserted, remove


def send(report):
    """Return a report as it arrives from another process."""
    return pickle.loads(pickle.dumps(report))


def run(world, edits, rules) -> bool:
    """Derive the first edit in a copy while the closure takes the others; return if it counts."""
    asserted = {*world[0], *world[1]}
    closure = Closure.build(asserted, [], rules)
    before = set(closure.inferred())
    copy, handover = copy_of(closure, rules), closure.hand_over()
    follower = Follower(copy, never)
    plus, minus = edited(asserted, *edits[0])
    staged = copy.stage(plus, minus)
    if staged.contradictions:
        return False
    follower.apply(staged)
    for number, edit in enumerate(edits[1:]):
        # Neither adds what the other removes: the store would count graphs to find out.
        gained, lost = edited(asserted, *edit)
        gained, lost = gained - minus, lost - plus
        step = closure.stage(gained, lost)
        if step.contradictions:
            continue
        step.apply()
        asserted = (asserted - lost) | gained
        for taken in handover.take_steps():
            if not follower.take(send(taken)):
                return False
        if number == 0:  # a first report, after which there is more to say
            report = send(follower.report())
            handover.encode(report)
            handover.receive(report)
    before = set(closure.inferred())
    report = send(follower.report())
    handover.encode(report)
    handover.receive(report)
    adopted = closure.adopt(handover, plus - asserted, minus & asserted)
    assert adopted is not None
    closure.end_handover(handover)
    adopted.apply()
    asserted = (asserted - minus) | plus
    fresh = Closure.build(asserted, [], rules, IN_BULK)
    after = set(closure.inferred())
    assert after == set(fresh.inferred()) == set(copy.inferred())
    assert set(adopted.inferred_added) == after - before
    assert set(adopted.inferred_removed) == before - after
    assert clashes(closure) == clashes(fresh)
    assert closure.digest() == fresh.digest()
    assert set(closure.match()) == set(fresh.match())
    # It goes on as one that derived everything itself.
    ordered = sorted(asserted, key=str)
    gone = set(ordered[::3])
    closure.stage(remove=gone).apply()
    assert set(closure.inferred()) == set(Closure.build(asserted - gone, [], rules).inferred())
    return True


@pytest.mark.slow
@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
@pytest.mark.parametrize("rules", [(), RULES], ids=["owl", "rules that negate"])
def test_what_a_copy_derived_equals_a_rebuild_whatever_came_between(size, rules, examples):
    counted = []

    @settings(SOME, max_examples=examples)
    @given(size.worlds(), size.edits().filter(bool))
    def check(world, edits):
        counted.append(run(world, edits, rules))

    check()
    assert sum(counted) > len(counted) / 3  # the others contradict something


TINY = """
:Mug rdfs:subClassOf :Vessel . :m1 a :Mug .
:part a owl:TransitiveProperty . :a :part :b .
"""


def handed_over(add: str, meanwhile: str = "") -> tuple[Closure, Closure, object]:
    """Return a closure, its copy with a change, and the handover after the closure's own."""
    closure = Closure.build(triples(TINY), [])
    copy, handover = copy_of(closure), closure.hand_over()
    follower = Follower(copy, never)
    follower.apply(copy.stage(triples(add)))
    closure.stage(triples(meanwhile)).apply()
    for step in handover.take_steps():
        assert follower.take(step)
    report = follower.report()
    handover.encode(report)
    handover.receive(report)
    return closure, copy, handover


def test_facts_of_both_sides_meet_though_neither_knew_of_the_other():
    closure, _, handover = handed_over(
        ":b :part :c . :Vessel rdfs:subClassOf :Any .", ":c :part :d ."
    )
    staged = closure.adopt(handover, triples(":b :part :c . :Vessel rdfs:subClassOf :Any ."), [])
    staged.apply()
    assert closure.contains(triples(":a :part :d .")[0])
    assert closure.contains(triples(":m1 a :Any .")[0])


def test_a_change_that_is_another_by_now_is_not_adopted():
    closure, _, handover = handed_over(":b :part :c .")
    assert closure.adopt(handover, triples(":b :part :x ."), []) is None
    assert closure.adopt(handover, triples(":b :part :c ."), triples(":a :part :b .")) is None
    assert closure.adopt(handover, triples(":b :part :c ."), []) is not None


def test_nothing_is_adopted_while_a_change_is_missing_in_the_copy():
    closure, _, handover = handed_over(":b :part :c .")
    closure.stage(triples(":x a :Mug .")).apply()
    assert handover.has_steps
    assert closure.adopt(handover, triples(":b :part :c ."), []) is None


def test_more_than_may_follow_from_a_change_is_not_adopted():
    closure, _, handover = handed_over(":b :part :c .", ":c :part :d .")
    assert closure.adopt(handover, triples(":b :part :c ."), [], derived=2) is None
    assert closure.adopt(handover, triples(":b :part :c ."), [], derived=3) is not None


def test_a_change_that_contradicts_what_came_meanwhile_is_told_by_the_copy():
    closure = Closure.build(triples(TINY), [])
    copy, handover = copy_of(closure), closure.hand_over()
    follower = Follower(copy, never)
    follower.apply(copy.stage(triples(":Mug owl:disjointWith :Pen .")))
    closure.stage(triples(":m1 a :Pen .")).apply()
    (step,) = handover.take_steps()
    assert not follower.take(step)


def test_a_copy_is_not_waited_for_after_a_change_as_large_as_a_load():
    closure = Closure.build(triples(TINY), [])
    handover = closure.hand_over()
    p = NamedNode("urn:p")
    many = [(NamedNode(f"urn:{i}"), p, NamedNode("urn:o")) for i in range(MAX_STEP + 1)]
    closure.stage(many).apply()
    assert handover.is_broken
    assert handover.take_steps() == []


def test_the_watch_ends_what_a_copy_does():
    class EndedError(Exception):
        pass

    def end() -> None:
        raise EndedError

    closure = Closure.build(triples(TINY), [])
    copy, handover = copy_of(closure), closure.hand_over()
    links = " ".join(f":n{i} :part :n{i + 1} ." for i in range(100))
    closure.stage(triples(links), budget=ChangeBudget(10**6, 10**6)).apply()
    (step,) = handover.take_steps()
    with pytest.raises(EndedError):
        Follower(copy, end).take(step)
