"""What a copy of the process derived from a long commit is adopted, whatever others wrote."""

from __future__ import annotations

import contextlib
import random
import threading
from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import pytest
from pyoxigraph import Quad

import rtask
from rtask.errors import BusyError, InconsistentError, RtaskError
from rtask.kb.commit import budget
from rtask.kb.commit.access import Access
from rtask.kb.commit.budget import UNBOUNDED
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.trials import derivation
from rtask.kb.commit.trials.derivation import LongDerivationError, TrialDerivations
from rtask.kb.commit.trials.process import CAN_FORK
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import RDF, RDFS
from rtask.rdf.terms import iri

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CAN_FORK, reason="all is derived under the lock here"),
]

PREFIXES = (
    "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
    "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
)
ROBOT = Access("nao-1", "robot", frozenset(("schema",)))
Meanwhile = list[Callable[[], object]]


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:") as opened:
        opened.update("INSERT DATA { <urn:a> a <urn:B> }")
        yield opened


@pytest.fixture
def meanwhile(monkeypatch: pytest.MonkeyPatch) -> Meanwhile:
    """What others do, each during one trial; a first look at a robot's commit never suffices."""
    for name in ("_FIRST_FIRINGS", "_FIRST_FIRINGS_EACH", "_FIRST_DERIVED", "_FIRST_DERIVED_EACH"):
        monkeypatch.setattr(budget, name, 0)
    waiting: Meanwhile = []
    outcome = derivation.Trial.outcome

    def act_and_wait(trial: derivation.Trial, until: float | None) -> Any:
        if waiting:
            waiting.pop(0)()
        return outcome(trial, until)

    monkeypatch.setattr(derivation.Trial, "outcome", act_and_wait)
    return waiting


@pytest.fixture
def adopted(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether what was tried was adopted, commit by commit."""
    results: list[bool] = []
    adopt = Inference.adopt

    def record(inference: Inference, *arguments: Any) -> Any:
        result = adopt(inference, *arguments)
        results.append(result is not None)
        return result

    monkeypatch.setattr(Inference, "adopt", record)
    return results


def write(kb: KnowledgeBase, text: str, access: Access | None = None) -> rtask.Commit:
    return kb.update(PREFIXES + text, access=access)


def assert_current(kb: KnowledgeBase) -> None:
    """Compare the inferred graph with what follows from the asserted statements alone."""
    inference = kb._writer.committer.inference
    assert inference is not None
    adopted = inference.closure()
    with kb._writer.exclusive():
        missing, surplus = inference.difference()
    fresh = inference.closure()
    assert (list(missing), surplus) == ([], [])
    assert set(adopted.match()) == set(fresh.match())


def test_what_was_tried_is_adopted_with_what_follows_from_both_sides(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    meanwhile.append(lambda: write(kb, "INSERT DATA { <urn:n3> <urn:t> <urn:n4> , <urn:new> }"))
    text = (
        "INSERT DATA { <urn:t> a owl:TransitiveProperty . <urn:n1> <urn:t> <urn:n2> ."
        " <urn:n2> <urn:t> <urn:n3> . [] <urn:t> <urn:n1> }"
    )
    done = write(kb, text, ROBOT)
    assert adopted == [True]
    assert kb.query("ASK { <urn:n1> <urn:t> <urn:n4> , <urn:new> }")
    assert done.derived == 2 + 2 + 1 + 4  # from n1, n2, and four from the blank node
    assert_current(kb)


def test_a_change_that_another_one_made_in_part_meanwhile_is_adopted(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    meanwhile.append(lambda: write(kb, "INSERT DATA { <urn:M> rdfs:subClassOf <urn:V> }"))
    write(kb, "INSERT DATA { <urn:M> rdfs:subClassOf <urn:V> . <urn:m> a <urn:M> }", ROBOT)
    assert adopted == [True]
    assert kb.query("ASK { <urn:m> a <urn:V> }")
    write(kb, "DELETE DATA { <urn:M> rdfs:subClassOf <urn:V> . <urn:m> a <urn:M> }", ROBOT)
    assert kb.query(PREFIXES + "ASK { <urn:M> rdfs:subClassOf <urn:V> }")
    assert_current(kb)


def test_a_change_that_is_another_after_the_trial_is_tried_once_more_and_then_derived(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    for number in range(3):
        meanwhile.append(partial(write, kb, f"INSERT DATA {{ <urn:s{number}> <urn:c> 1 }}"))
    update = "INSERT { ?s a <urn:Counted> } WHERE { ?s <urn:c> ?n }"
    write(kb, "INSERT DATA { <urn:s> <urn:c> 0 . <urn:Counted> rdfs:subClassOf <urn:Any> }")
    done = kb.update(update, access=ROBOT, limits=UpdateLimits(20.0))
    assert adopted == [False, False]
    assert done.added == 3
    assert len(meanwhile) == 1
    assert_current(kb)


def test_a_commit_that_contradicts_what_came_during_its_trial_is_refused(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    meanwhile.append(lambda: write(kb, "INSERT DATA { <urn:p1> a <urn:Pen> }"))
    text = "INSERT DATA { <urn:Pen> owl:disjointWith <urn:Cup> . <urn:p1> a <urn:Cup> }"
    with pytest.raises(InconsistentError, match="urn:p1"):
        write(kb, text, ROBOT)
    assert adopted == [False]
    assert not kb.query("ASK { <urn:p1> a <urn:Cup> }")
    assert_current(kb)


def random_change(rng: random.Random) -> str:
    """Return an update of a few axioms and facts, which may remove what others added."""
    terms = [f"<urn:r:{i}>" for i in range(6)]
    classes = [f"<urn:r:C{i}>" for i in range(3)]
    links = ["<urn:r:p>", "<urn:r:q>"]
    kinds = ("Transitive", "Symmetric", "Functional")
    statements = [
        f"{rng.choice(classes)} rdfs:subClassOf {rng.choice(classes)}",
        f"{rng.choice(links)} a owl:{rng.choice(kinds)}Property",
        f"{rng.choice(links)} rdfs:domain {rng.choice(classes)}",
        f"{rng.choice(terms)} owl:sameAs {rng.choice(terms)}",
        *(f"{rng.choice(terms)} {rng.choice(links)} {rng.choice(terms)}" for _ in range(3)),
        f"{rng.choice(terms)} a {rng.choice(classes)}",
        f"{rng.choice(terms)} <urn:r:value> {rng.randrange(3)}",
    ]
    verb = rng.choice(("INSERT", "INSERT", "DELETE"))
    return f"{verb} DATA {{ {' . '.join(rng.sample(statements, rng.randint(1, 4)))} }}"


def test_random_commits_with_others_in_between_leave_what_a_full_derivation_gives(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    rng = random.Random(33)
    for _ in range(8):
        for _ in range(rng.randrange(3)):
            meanwhile.append(partial(write, kb, random_change(rng)))
        write(kb, random_change(rng), ROBOT)
        meanwhile.clear()
        assert_current(kb)
    assert sum(adopted) > len(adopted) / 2


def test_a_rehearsed_change_lets_others_write_meanwhile_and_stores_nothing(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    meanwhile.append(lambda: write(kb, "INSERT DATA { <urn:r3> <urn:u> <urn:r4> }"))
    write(kb, "INSERT DATA { <urn:r1> <urn:u> <urn:r2> . <urn:r2> <urn:u> <urn:r3> }")
    transitive = "http://www.w3.org/2002/07/owl#TransitiveProperty"
    axiom = Quad(iri("urn:u"), RDF.type, iri(transitive), kb.graphs.agent("nao-1"))
    before = kb.seq
    trial = kb.try_change([axiom])
    assert meanwhile == []
    assert (kb.seq, trial.seq, trial.added) == (before + 1, before + 1, 1)
    assert trial.derived >= 3, "r1 and r2 to r4, by what came meanwhile, and r1 to r3"
    assert not kb.query("ASK { <urn:r1> <urn:u> <urn:r4> }")
    assert_current(kb)
    done = kb.update(f"INSERT DATA {{ <urn:u> a <{transitive}> }}")
    assert done.derived == trial.derived


def test_a_rehearsal_is_refused_as_the_commit_would_be(
    kb: KnowledgeBase, meanwhile: Meanwhile, adopted: list[bool]
) -> None:
    write(kb, "INSERT DATA { <urn:q1> a <urn:Lid> , <urn:Pot> }")
    disjoint = iri("http://www.w3.org/2002/07/owl#disjointWith")
    axiom = Quad(iri("urn:Lid"), disjoint, iri("urn:Pot"), kb.graphs.agent("nao-1"))
    with pytest.raises(InconsistentError, match="urn:q1"):
        kb.try_change([axiom])
    everything = Quad(RDFS.subClassOf, RDF.type, iri("http://www.w3.org/2002/07/owl#SymmetricProperty"),
                  kb.graphs.agent("nao-1"))  # fmt: skip
    with pytest.raises(RtaskError):
        kb.try_change([everything])
    assert_current(kb)


def test_an_author_leaves_a_place_to_the_trials_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(derivation, "Trial", _Idle)
    stop = threading.Event()
    trials = TrialDerivations(cast("Any", None), contextlib.nullcontext, stop)
    change = LongDerivationError([], [], None, 1, UNBOUNDED, None, cast("Any", None))
    with trials.tried(change, "nao-1"), trials.tried(change, "nao-2"):
        stop.set()  # whoever waits is told so
        for who in ("nao-1", "nao-3", None):
            with pytest.raises(BusyError, match="stopping"), trials.tried(change, who):
                pass
    with trials.tried(change, "nao-1"):
        with pytest.raises(BusyError), trials.tried(change, "nao-1"):
            pass
        with trials.tried(change, "nao-3"):
            pass
    with trials.tried(change), trials.tried(change):
        pass


class _Idle:
    """A trial of which nothing comes."""

    def __init__(self, *_: object) -> None:
        pass

    def outcome(self, _: float | None) -> Any:
        return SimpleNamespace(error=None, contradictions=())

    def catch_up(self) -> None:
        pass

    def end(self) -> None:
        pass
