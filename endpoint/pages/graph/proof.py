"""Proof page: why the graph holds a statement, and how to withdraw what it rests on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from urllib.parse import urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.http.messages import RefusedError
from endpoint.pages.graph.naming import names_of
from endpoint.pages.render import Model, blueprint, context, current_request, embedded_graph, page
from endpoint.pages.signin import require_form
from endpoint.routes.reasoning import BUDGET, MAX_BUDGET
from reasoner import Proof, Refutation, Undecided
from rtask.asking.decisions import Explanation
from rtask.asking.decisions import explain as explained
from rtask.asking.terms import reader_of
from rtask.kb.commit.access import Access
from rtask.rdf.terms import NamedNode, TripleKey

_ADDRESS = "/explain"
MAX_COMMITS = 2_000
RULES = "https://www.w3.org/TR/owl2-profiles/#Reasoning_in_OWL_2_RL_and_RDF_Graphs_using_Rules"
# OWL 2 Profiles, 4.3.
_TABLES = {
    "eq": "Table 4, equality",
    "prp": "Table 5, properties",
    "cls": "Table 6, classes",
    "cax": "Table 7, class axioms",
    "dt": "Table 8, datatypes",
    "scm": "Table 9, schema vocabulary",
}


def table_of(rule: str) -> str:
    """Return the table of OWL 2 Profiles in which a rule stands; empty for rules of users.

    Examples
    --------
    >>> table_of("cax-sco"), table_of("rule:heavy")
    ('Table 7, class axioms', '')
    """
    return _TABLES.get(rule.partition("-")[0], "")


@blueprint.app_template_filter("explain_url")
def explain_url(terms: list[str]) -> str:
    """Return the address of the proof of a statement.

    Parameters
    ----------
    terms
        Subject, predicate and object, as in N-Triples.
    """
    return f"{_ADDRESS}?{urlencode(dict(zip('spo', terms, strict=True)))}"


@blueprint.app_template_filter("ntriples")
def ntriples(term: dict[str, str]) -> str:
    """Return a term of a page's model as in N-Triples."""
    if term["kind"] == "iri":
        return f"<{term['text']}>"
    if term["kind"] != "literal":
        return term["text"]
    escaped = term["text"].translate(_ESCAPES)
    if "language" in term:
        return f'"{escaped}"@{term["language"]}'
    return f'"{escaped}"^^<{term["datatype"]}>'


@blueprint.app_template_test("anonymous")
def has_blank_node(text: str) -> bool:
    """Tell whether a statement has an anonymous part, which has no address."""
    return "_:" in text


_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t"})


@page(_ADDRESS, "proof.html")
def explain() -> Model:
    """Return whether a statement holds, who states it, and its proof from stated ones."""
    kb = embedded_graph()
    triple = _statement()
    terms = [str(term) for term in triple]
    explanation = explained(kb, triple, _budget())
    proof = explanation.decision
    if not isinstance(proof, Proof):
        named = names_of(kb, [term[1:-1] for term in terms if term.startswith("<")])
        return {
            "terms": terms,
            "names": named,
            "asserted": [],
            "proof": None,
            **_why_not(explanation),
        }
    leaves = {leaf.triple: leaf for leaf in _leaves(proof)}
    assertions = _assertions(set(leaves))
    step = _step(proof, assertions, _access())
    return {
        "terms": terms,
        "names": names_of(kb, sorted(set(_iris(step)))),
        "holds": True,
        "asserted": [name.strip("<>") for name in explanation.asserted_in],
        "proof": step,
    }


def _statement() -> TripleKey:
    """Return the statement that the address names.

    Raises
    ------
    RefusedError
        A part is missing.
    UsageError, UnknownTermError
        A part is no term, or the subject or predicate is no IRI or name.
    """
    given = [flask.request.values.get(name, "").strip() for name in "spo"]
    if not all(given):
        raise RefusedError(400, "usage", f"which statement? {_ADDRESS}?s=<IRI>&p=<IRI>&o=<term>")
    return reader_of(embedded_graph()).statement(*given)


def _budget() -> int:
    """Return the steps that the address asks for, within what a request may have."""
    given = flask.request.args.get("budget", "")
    return min(max(int(given[:9]), 1), MAX_BUDGET) if given.isdecimal() else BUDGET


def _why_not(explanation: Explanation) -> Model:
    """Return what a statement lacks, or how to ask for more than the budget that did not decide."""
    decision = explanation.decision
    if isinstance(decision, Undecided):
        more = min(decision.more, MAX_BUDGET)
        return {
            "holds": None,
            "budget": decision.budget,
            "more": more if more > decision.budget else None,
        }
    assert isinstance(decision, Refutation)
    return {
        "holds": False,
        "needs": [need.to_dict() for need in decision.needs],
        "unknown": list(decision.unknown),
    }


def _leaves(proof: Any) -> Iterator[Any]:
    if proof.is_asserted:
        yield proof
    for premise in proof.premises:
        yield from _leaves(premise)


def _assertions(triples: set[Any]) -> dict[Any, list[dict[str, str]]]:
    """Return who added each of some statements, and when, as far as recent commits tell."""
    feed = embedded_graph().feed
    after = max(feed.last_seq - MAX_COMMITS, 0)
    assertions: dict[Any, list[dict[str, str]]] = {}
    for change in feed.changes(after, feed.last_seq):
        for quad in change.added:
            triple = (quad.subject, quad.predicate, quad.object)
            if triple in triples:
                when = change.commit.time.isoformat()
                assertions.setdefault(triple, []).append({"by": change.agent or "", "time": when})
    return assertions


def _step(proof: Any, assertions: dict[Any, list[dict[str, str]]], access: Access) -> Model:
    """Return one step of a proof, with those that it rests on."""
    kb = embedded_graph()
    graphs = [name.strip("<>") for name in proof.graphs]
    return {
        "terms": [str(term) for term in proof.triple],
        "gloss": proof.gloss,
        "rule": proof.rule,
        "table": table_of(proof.rule),
        "graphs": graphs,
        "said": assertions.get(proof.triple, []),
        "may_withdraw": proof.is_asserted
        and any(
            access.may_write(NamedNode(name)) and not kb.catalogue.is_ontology(NamedNode(name))
            for name in graphs
        ),
        "absent": list(proof.absent),
        "schema": [[str(term) for term in triple] for triple in proof.schema],
        "premises": [_step(premise, assertions, access) for premise in proof.premises],
    }


def _iris(step: Model) -> Iterator[str]:
    """Return the IRIs in a proof, with those of the schema that its rules read."""
    for term in (*step["terms"], *(term for triple in step["schema"] for term in triple)):
        if term.startswith("<"):
            yield term[1:-1]
    for premise in step["premises"]:
        yield from _iris(premise)


def _access() -> Access:
    """Return the rights of the person on this graph."""
    kb = embedded_graph()
    access = context().auth.identify(current_request()).access
    return access.bind(kb.graphs, kb.catalogue.is_ontology, kb.plain)


@blueprint.route(f"{_ADDRESS}/withdraw", methods=["POST"])
def withdraw() -> WerkzeugResponse:
    """Withdraw a statement from the graphs that the person may write, and show the proof again."""
    caller = require_form("teach")
    triple = _statement()
    embedded_graph().retract(*triple, access=caller.access, reason="withdrawn on its proof")
    context().audit.event("withdraw", statement=" ".join(map(str, triple)), by=caller.name)
    there = {name: flask.request.form.get(f"of_{name}", "") for name in "spo"}
    return flask.redirect(f"{_ADDRESS}?{urlencode(there)}", 303)
