"""Random updates: the computed change equals what the store itself would have done."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import DataError
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.knowledge_base import KnowledgeBase

_GRAPHS = ("<urn:g1>", "<urn:g2>", "<urn:g3>")
_TERMS = ("<urn:a>", "<urn:b>", "<urn:c>", '"x"', "01", '"y"@en', "2.50", "_:n")
_PREDICATES = ("<urn:p>", "<urn:q>")


def _subject(rng: random.Random) -> str:
    return rng.choice(("<urn:a>", "<urn:b>", "<urn:c>", "_:m"))


def _triples(rng: random.Random, blank: bool = True) -> str:
    lines = []
    for _ in range(rng.randint(1, 3)):
        line = f"{_subject(rng)} {rng.choice(_PREDICATES)} {rng.choice(_TERMS)}"
        lines.append(line if blank else line.replace("_:m", "<urn:a>").replace("_:n", "<urn:b>"))
    return " . ".join(lines)


def _quads(rng: random.Random, blank: bool = True) -> str:
    loose = _triples(rng, blank) if rng.random() < 0.6 else ""
    named = f"GRAPH {rng.choice(_GRAPHS)} {{ {_triples(rng, blank)} }}"
    return f"{loose} {named}" if rng.random() < 0.6 else loose or named


def _modify(rng: random.Random) -> str:
    where = rng.choice(
        (
            "?s ?p ?o",
            "GRAPH ?g { ?s ?p ?o }",
            "?s ?p ?o OPTIONAL { ?o ?q ?z }",
            "GRAPH <urn:g1> { ?s ?p ?o } FILTER(isIRI(?o))",
            "?s <urn:p> ?o . ?s <urn:q> ?z",
        )
    )
    delete = rng.choice(("", "DELETE { ?s ?p ?o }", "DELETE { GRAPH <urn:g2> { ?s ?p ?o } }"))
    insert = rng.choice(
        (
            "INSERT { ?o <urn:p> ?s }",
            "INSERT { GRAPH ?g { ?s <urn:q> ?z } ?s <urn:q> _:new . _:new <urn:p> ?o }",
            "INSERT { GRAPH <urn:g3> { ?s ?p ?o } }",
        )
    )
    if delete and rng.random() < 0.4:
        insert = ""
    scope = rng.choice(("", "", f"WITH {rng.choice(_GRAPHS)}"))
    using = "" if scope else rng.choice(("", "", f"USING {rng.choice(_GRAPHS)}"))
    if using and rng.random() < 0.5:
        using += f" USING NAMED {rng.choice(_GRAPHS)}"
    return f"{scope} {delete} {insert} {using} WHERE {{ {where} }}"


def _operation(rng: random.Random) -> str:
    kind = rng.random()
    if kind < 0.35:
        return f"INSERT DATA {{ {_quads(rng)} }}"
    if kind < 0.45:
        return f"DELETE DATA {{ {_quads(rng, blank=False)} }}"
    if kind < 0.55:
        return "DELETE WHERE { ?s <urn:q> ?o }"
    if kind < 0.88:
        return _modify(rng)
    verb = rng.choice(("CLEAR", "DROP", "CREATE", "COPY", "MOVE", "ADD"))
    if verb == "CREATE":
        return f"CREATE SILENT GRAPH {rng.choice(_GRAPHS)}"
    if verb in ("CLEAR", "DROP"):
        return f"{verb} SILENT " + rng.choice(
            ("DEFAULT", "NAMED", "ALL", "GRAPH " + rng.choice(_GRAPHS))
        )
    ends = rng.choices((*_GRAPHS, "DEFAULT"), k=2)
    # a missing source is an error for us and an empty graph for the store
    first = "" if ends[0] == "DEFAULT" else f"CREATE SILENT GRAPH {ends[0]} ; "
    return f"{first}{verb} {ends[0]} TO {ends[1]}"


def _request(rng: random.Random) -> str:
    """Return up to three operations; a blank node label may stand in one of them only."""
    count = rng.randint(1, 3)
    return " ;\n".join(_operation(rng).replace("_:", f"_:{'abc'[at]}") for at in range(count))


def _canonical(quads: Iterator[ox.Quad]) -> list[str]:
    dataset = ox.Dataset(quads)
    dataset.canonicalize(ox.CanonicalizationAlgorithm.UNSTABLE)
    return sorted(map(str, dataset))


@pytest.mark.slow
@pytest.mark.parametrize("limits", [None, UpdateLimits(60.0)], ids=["in-process", "in-reader"])
@pytest.mark.parametrize("seed", range(12))
def test_the_store_ends_as_if_it_had_run_the_update_itself(
    seed: int, limits: UpdateLimits | None
) -> None:
    rng = random.Random(seed)
    native = ox.Store()
    with rtask.open(":memory:", plain=True) as kb:
        for _ in range(25):
            text = _request(rng)
            native.update(text)
            kb.update(text, limits=limits)
            assert _canonical(kb.store.quads_for_pattern(None, None, None)) == _canonical(
                iter(native)
            ), text
            if len(native) > 60:  # canonical forms of many blank nodes take long
                native.clear()
                kb.update("DROP ALL")


def _union_is_exact(kb: KnowledgeBase) -> bool:
    named = {str(q.triple) for q in kb.match()}
    union = [str(q.triple) for q in kb.match(graph=ox.DefaultGraph())]
    return sorted(named) == sorted(union)


@pytest.mark.slow
@pytest.mark.parametrize("limits", [None, UpdateLimits(60.0)], ids=["in-process", "in-reader"])
@pytest.mark.parametrize("seed", range(6))
def test_the_default_graph_stays_the_exact_union_of_all_graphs(
    seed: int, limits: UpdateLimits | None
) -> None:
    rng = random.Random(seed)
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        for _ in range(25):
            text = _request(rng)
            try:
                kb.update(text, limits=limits)
            except DataError:
                continue
            assert _union_is_exact(kb), text
            if kb.stats()["asserted"] > 80:
                kb.update("DROP ALL")
        assert kb.verify() == []
