"""``rtask reason`` and ``rtask explain``: check consistency, and show proofs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_to_read, reasoner_of
from rtask.cli.options import (
    budget_option,
    data_option,
    exit_if_empty,
    exit_undecided,
    json_option,
    listing,
    print_json,
    server_option,
    shown_parts,
)
from rtask.cli.progress import Working, announce_compilation

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

_OWL = "http://www.w3.org/2002/07/owl#"
_SUB_CLASS = "http://www.w3.org/2000/01/rdf-schema#subClassOf"
_LISTED = 20
_CAUSE_MS = 10_000


@click.command()
@click.argument("files", nargs=-1, type=click.Path(path_type=Path, exists=True))
@data_option
@click.option(
    "--profile",
    type=click.Choice(["rl", "dl"]),
    default="rl",
    show_default=True,
    help="rl: the rules that commits use; dl: OWL 2 DL, which needs Java.",
)
@click.option(
    "--engine",
    type=click.Choice(["hermit", "pellet"]),
    default="hermit",
    show_default=True,
    help="Reasoner for --profile dl.",
)
@click.option(
    "--with-data", is_flag=True, help="For dl: include all asserted data, not just the ontology."
)
@click.option(
    "--timeout",
    type=float,
    default=120.0,
    show_default=True,
    metavar="S",
    help="For dl: stop after this time, s.",
)
@listing(_LISTED)
@json_option
def reason(
    files: tuple[Path, ...],
    data: Path,
    profile: str,
    engine: str,
    with_data: bool,
    timeout: float,
    limit: int | None,
    as_json: bool,
) -> None:
    """Check consistency, and list the classes that can have no member.

    Checks the knowledge base, or FILES where some are given. With --profile dl, also lists
    subclasses that follow under OWL 2 DL but not under the rules that commits use. Exit code 1 if
    it is inconsistent.
    """
    with announce_compilation(), Working("reasoning"):
        if files:
            triples, rules = _read(files), _rules()
        else:
            with open_to_read(data) as kb:
                triples = _asserted(kb, ontologies_only=profile == "dl" and not with_data)
                rules = _rules(kb)
        report = _rl(triples, rules) if profile == "rl" else _dl(triples, engine, timeout)
    counts = {name: len(value) for name, value in report.items() if isinstance(value, list)}
    report = shown_parts(report, limit, as_json, default=_LISTED)
    if as_json:
        print_json(report)
    else:
        for line in _lines(report, counts):
            click.echo(line)
    if not report["consistent"]:
        raise SystemExit(1)


def _read(files: Iterable[Path]) -> list[Any]:
    from pyoxigraph import parse

    from rtask.errors import UsageError

    statements: dict[Any, None] = {}
    for file in files:
        try:
            for quad in parse(path=str(file)):
                statements[quad.subject, quad.predicate, quad.object] = None
        except (SyntaxError, ValueError) as error:
            raise UsageError(f"{file}: {error}") from error
    return list(statements)


def _asserted(kb: KnowledgeBase, ontologies_only: bool) -> list[Any]:
    graphs = kb.catalogue.ontologies() if ontologies_only else kb.store.named_graphs()
    return list(
        dict.fromkeys(
            (quad.subject, quad.predicate, quad.object)
            for graph in graphs
            if kb.graphs.is_input(graph)
            for quad in kb.store.quads_for_pattern(None, None, None, graph)
        )
    )


def _rl(triples: list[Any], rules: list[Any]) -> dict[str, Any]:
    from reasoner import Closure, check_profile

    closure = Closure.build(triples, [], rules=rules)
    clashes = closure.contradictions()
    outside = Counter(f"{v.construct} in {v.position}" for v in check_profile(triples))
    return {
        "profile": "rl",
        "triples": len(triples),
        "consistent": not clashes,
        "contradictions": [str(clash) for clash in clashes],
        "causes": _causes(closure) if clashes else [],
        "unsatisfiable": _empty_classes(closure),
        "outside of OWL 2 RL": dict(outside.most_common()),
        "problems": closure.stats()["problems"],
    }


def _causes(closure: Any) -> list[str]:
    """Return the smallest sets of statements behind the contradictions, one line each."""
    from rtask.kb.commit.conflict import cause_of
    from rtask.kb.store.naming import prefixed

    return [cause_of(cause, prefixed, _LISTED) for cause in closure.causes(budget_ms=_CAUSE_MS)]


def _dl(triples: list[Any], engine: str, timeout: float) -> dict[str, Any]:
    from reasoner import Closure
    from reasoner.dl import hermit, pellet
    from rtask.errors import UnsupportedError

    check = hermit.check if engine == "hermit" else pellet.check
    try:
        answer = check(triples, classify=True, timeout_s=timeout)
    except (hermit.DLUnavailableError, hermit.DLError) as error:
        raise UnsupportedError(str(error)) from error
    closure = Closure.build(triples, [])
    hierarchy = {
        (s.value, o.value)
        for s, _, o in closure.match(None, _node(_SUB_CLASS), None)
        if hasattr(s, "value") and hasattr(o, "value")
    }
    more = hermit.hierarchy(answer) - hierarchy
    return {
        "profile": "dl",
        "engine": engine,
        "triples": len(triples),
        "consistent": answer.is_consistent,
        "unsatisfiable": sorted(answer.unsatisfiable),
        "subclasses that OWL 2 RL does not find": [" < ".join(pair) for pair in sorted(more)],
    }


def _node(iri: str) -> Any:
    from pyoxigraph import NamedNode

    return NamedNode(iri)


def _rules(kb: KnowledgeBase | None = None) -> list[Any]:
    """Return the rules that ship with the ontology, and those of a knowledge base."""
    from rtask.kb.commit.inference import labelled, shipped_rules

    return [*shipped_rules(), *(map(labelled, kb.rules()) if kb is not None else ())]


def _empty_classes(closure: Any) -> list[str]:
    """Return the named classes below owl:Nothing, and those below two disjoint ones."""
    from pyoxigraph import NamedNode

    below = closure.match(None, _node(_SUB_CLASS), None)
    above: dict[Any, set[Any]] = {}
    for s, _, o in below:
        above.setdefault(s, {s}).add(o)
    empty = {s for s, supers in above.items() if _node(_OWL + "Nothing") in supers}
    for a, _, b in closure.match(None, _node(_OWL + "disjointWith"), None):
        empty |= {s for s, supers in above.items() if {a, b} <= supers}
    return sorted(
        s.value for s in empty if isinstance(s, NamedNode) and s.value[: len(_OWL)] != _OWL
    )


def _lines(report: dict[str, Any], counts: dict[str, int]) -> Iterable[str]:
    """Yield a report as text, with how many entries each of its listings has."""
    yield f"{report['triples']} triples under OWL 2 {report['profile'].upper()}"
    yield "consistent" if report["consistent"] else "INCONSISTENT"
    for key, value in report.items():
        if isinstance(value, dict):
            yield f"{key}: {len(value) or 'none'}"
            yield from (f"  {count} {what}" for what, count in value.items())
        elif isinstance(value, list):
            yield f"{key}: {counts[key] or 'none'}"
            yield from (f"  {line}" for line in value)


@click.command()
@click.argument("subject")
@click.argument("predicate")
@click.argument("value", metavar="OBJECT")
@data_option
@server_option
@budget_option
@json_option
def explain(
    subject: str,
    predicate: str,
    value: str,
    data: Path,
    server: str | None,
    budget: int | None,
    as_json: bool,
) -> None:
    """Explain why a statement holds, or what it lacks.

    Prints who asserted it, or what it follows from. Write terms as any command prints them: <IRI>,
    prefix:name, kb:name, "a name", "text", 0.3. Exit code 1 if the statement does not hold, 3 if
    the budget did not suffice to decide it.
    """
    parts = (subject, predicate, value)
    explanation = (
        _explained_by(server, parts, budget) if server else _explained(data, parts, budget)
    )
    if as_json:
        print_json(explanation)
    else:
        for name in explanation["asserted_in"]:
            click.echo(f"asserted in {name}")
        if explanation["proof"] is not None:
            click.echo(explanation["proof"])
        if not explanation["holds"]:
            click.echo(explanation["reason"], err=True)
    exit_undecided(explanation["holds"])
    exit_if_empty(explanation["holds"])


def _explained(data: Path, parts: tuple[str, str, str], budget: int | None) -> dict[str, Any]:
    """Return why a statement holds in a folder; a proof only where nobody asserted it."""
    from rtask.asking.decisions import explain as decide
    from rtask.asking.terms import reader_of
    from rtask.kb.reasoning import PROOF_BUDGET

    with announce_compilation(), open_to_read(data) as kb:
        triple = reader_of(kb).statement(*parts)
        return _shortened(decide(kb, triple, budget or PROOF_BUDGET).to_dict())


def _explained_by(server: str, parts: tuple[str, str, str], budget: int | None) -> dict[str, Any]:
    """Return the same of a server, which reads the terms."""
    with reasoner_of(server) as client:
        return _shortened(client.explain(parts, budget))


def _shortened(explanation: dict[str, Any]) -> dict[str, Any]:
    """Return an explanation with its proof as text and as steps, for what nobody asserted."""
    asserted = bool(explanation["asserted_in"])
    return {
        **{name: value for name, value in explanation.items() if name != "text"},
        "proof": None if asserted else explanation["text"],
        "steps": None if asserted else explanation["proof"],
    }
