"""A statement holds, does not hold, or is not decided: never one for another."""

from __future__ import annotations

import pytest

import ontology
from reasoner import Refutation, Undecided
from rtask.asking.decisions import explain
from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, TripleKey, iri

RT = ontology.NS
HOLDS: TripleKey = (iri("urn:lab/object/8"), RDF_TYPE, iri(RT + "Container"))
DOES_NOT: TripleKey = (iri("urn:lab/object/8"), iri(RT + "graspOf"), iri("urn:lab/object/7"))


def test_a_fact_that_holds_is_never_denied_whatever_the_budget(kb: KnowledgeBase) -> None:
    answers = {kb.explain(*HOLDS, budget=steps).holds for steps in range(1, 60)}
    assert answers == {None, True}


def test_the_same_budget_gives_the_same_answer(kb: KnowledgeBase) -> None:
    first, again = (kb.explain(*HOLDS, budget=2) for _ in range(2))
    assert isinstance(first, Undecided)
    assert first == again


def test_a_refutation_says_what_would_make_the_statement_hold(kb: KnowledgeBase) -> None:
    found = explain(kb, DOES_NOT)
    assert isinstance(found.decision, Refutation)
    needs = [need["missing"] for need in found.to_dict()["needs"]]
    assert ['kb:object/7 "the 5" mug, blue" rt:hasGrasp kb:object/8 "twin"'] in needs
    assert found.to_dict()["verdict"] == "does not hold"
    assert found.commit == kb.seq


def test_a_misspelt_term_is_told_from_one_that_nothing_has(kb: KnowledgeBase) -> None:
    misspelt = (iri("urn:lab/object/8"), iri(RT + "graspWidht"), iri("urn:lab/object/7"))
    reason = explain(kb, misspelt).to_dict()["reason"]
    assert "nothing is known of rt:graspWidht; did you mean 'rt:graspWidth'?" in reason


def test_texts_where_terms_are_needed_are_errors(kb: KnowledgeBase) -> None:
    with pytest.raises(UsageError, match="an IRI or a text"):
        kb.explain("urn:lab/object/8", RDF_TYPE, RT + "Mug")
    with pytest.raises(UsageError, match="prefixed name"):
        kb.explain("kb:object/8", RDF_TYPE, iri(RT + "Mug"))
    with pytest.raises(UsageError, match="prefixed name"):
        kb.explain("urn:lab/object/8", "rt:graspOf", iri(RT + "Mug"))


def test_an_entailment_that_runs_out_of_budget_is_undecided(kb: KnowledgeBase) -> None:
    statement = (iri("urn:lab/object/8"), RDF_TYPE, iri(RT + "Robot"))
    short = kb.entails([statement], budget=1)
    assert (short.answer, short.is_spent, short.missing) == (None, True, ())
    assert kb.entails([statement]).answer is False
