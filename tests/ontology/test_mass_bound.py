"""Bounds on masses that follow from grasps, although no robot weighs anything."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase

pytestmark = pytest.mark.slow

SCENE = """
INSERT DATA {
  :strong a cora:Robot ; rt:hasEndEffector :strongHand .
  :strongHand a rt:Hand ; rt:gripperType "big" ;
      rt:minOpening 0e0 ; rt:maxOpening 0.1e0 ; rt:maxPayload 2e0 .
  :weak a cora:Robot ; rt:hasEndEffector :weakHand .
  :weakHand a rt:Hand ; rt:gripperType "small" ;
      rt:minOpening 0e0 ; rt:maxOpening 0.1e0 ; rt:maxPayload 0.1e0 .
  :narrow a cora:Robot ; rt:hasEndEffector :narrowHand .
  :narrowHand a rt:Hand ; rt:gripperType "narrow" ;
      rt:minOpening 0e0 ; rt:maxOpening 0.01e0 ; rt:maxPayload 9e0 .
  :can a rt:Can ; rt:objectId "lab/can-1" ; rt:graspWidth 0.05e0 ; rt:hasGrasp :g .
  :other a rt:Can ; rt:objectId "lab/can-2" ; rt:exemplarOf :can .
  :heavy a rt:Can ; rt:objectId "lab/can-3" ; rt:graspWidth 0.05e0 .
  :g a rt:PlanarGrasp ; rt:gripperType "small" .
}"""
ATTEMPT = """
INSERT DATA {{
  :a{n} a rt:GraspAttempt ; rt:performedBy :{robot} ; rt:activates :{robot}Hand ;
      rt:executesGrasp :g ; rt:hasOutcome :o{n} .
  :o{n} a rt:GraspOutcome ; rt:success {success} ; rt:hasReason rt:{reason} .
}}"""
PREFIXES = "".join(f"PREFIX {p}: <{iri}>\n" for p, iri in ontology.PREFIXES.items())
PREFIXES += "PREFIX : <urn:t:>\n"


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:") as kb:
        kb.update(PREFIXES + SCENE)
        yield kb


def _attempt(kb: KnowledgeBase, n: int, robot: str, success: bool) -> None:
    reason = "reason_ok" if success else "reason_slip_lift"
    text = ATTEMPT.format(n=n, robot=robot, success=str(success).lower(), reason=reason)
    kb.update(PREFIXES + text)


def _can_grasp(kb: KnowledgeBase) -> set[tuple[str, str]]:
    rows = kb.select(PREFIXES + "SELECT ?r ?o { ?r rt:canGrasp ?o }")
    return {(str(r.value(0))[6:], str(r.value(1))[6:]) for r in rows}


def test_nothing_is_claimed_before_anybody_lifted_it(kb: KnowledgeBase) -> None:
    assert _can_grasp(kb) == set()
    _attempt(kb, 1, "weak", success=False)
    assert _can_grasp(kb) == set()


def test_what_a_weak_hand_lifted_a_stronger_one_can_lift_too(kb: KnowledgeBase) -> None:
    """So does an exemplar of the product; not what does not fit, not what nobody lifted."""
    _attempt(kb, 1, "weak", success=True)
    both = {("weak", "can"), ("strong", "can"), ("weak", "other"), ("strong", "other")}
    assert _can_grasp(kb) == both


def test_what_a_strong_hand_lifted_may_be_too_heavy_for_a_weak_one(kb: KnowledgeBase) -> None:
    _attempt(kb, 1, "strong", success=True)
    assert _can_grasp(kb) == {("strong", "can"), ("strong", "other")}


def test_it_is_withdrawn_when_a_person_says_it_was_not_held(kb: KnowledgeBase) -> None:
    _attempt(kb, 1, "weak", success=True)
    kb.update(
        PREFIXES + "INSERT DATA { :o1 rt:hasFeedback :f . :f a rt:HumanFeedback ; rt:verdict false"
        ' ; rt:atTime "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp }'
    )
    assert _can_grasp(kb) == set()


def test_a_stated_mass_counts_as_before(kb: KnowledgeBase) -> None:
    kb.update(PREFIXES + "INSERT DATA { :heavy rt:mass 1e0 }")
    assert _can_grasp(kb) == {("strong", "heavy")}


def test_the_claim_has_a_proof(kb: KnowledgeBase) -> None:
    _attempt(kb, 1, "weak", success=True)
    proof = kb.explain("urn:t:strong", ontology.NS + "canGrasp", _iri("urn:t:can"))
    assert proof is not None
    assert "massBound" in str(proof)


def _iri(text: str) -> object:
    from rtask.rdf.terms import iri

    return iri(text)
