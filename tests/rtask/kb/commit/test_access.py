"""Rights are decided on the exact change, so no spelling gets around them."""

from __future__ import annotations

from collections.abc import Iterator
from urllib.parse import quote, unquote

import pytest
from pyoxigraph import Quad

import rtask
from ontology import PREFIXES
from rtask.errors import ForbiddenError, UsageError
from rtask.kb.commit.access import Access, Role, actor_of, unnamed_person
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import iri

_OTHER = "urn:lab/graph/agent/nao-2"


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base="urn:lab/", ontologies=False, reason=False) as opened:
        opened.update(
            "INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 } "
            "GRAPH <urn:other> { <urn:s> <urn:p> 2 } }"
        )
        opened.update("INSERT DATA { <urn:mine> <urn:p> 1 }", agent="nao-1")
        opened.update("INSERT DATA { <urn:his> <urn:p> 1 }", agent="nao-2")
        yield opened


def _outside(kb: KnowledgeBase) -> set[str]:
    mine = kb.graphs.agent("nao-1")
    records = (kb.graphs.meta, kb.graphs.provenance)
    return {str(q) for q in kb.match() if q.graph_name not in (mine, *records)}


@pytest.mark.parametrize(
    "text",
    [
        f"INSERT DATA {{ GRAPH <{_OTHER}> {{ <urn:x> <urn:p> 1 }} }}",
        # already there: nothing would change, and still it is not his to say
        f"INSERT DATA {{ GRAPH <{_OTHER}> {{ <urn:his> <urn:p> 1 }} }}",
        f"DELETE DATA {{ GRAPH <{_OTHER}> {{ <urn:his> <urn:p> 1 }} }}",
        "PREFIX g: <urn:lab/graph/agent/> INSERT DATA { GRAPH g:nao-2 { <urn:x> <urn:p> 1 } }",
        "BASE <urn:lab/graph/agent/x> INSERT DATA { GRAPH <nao-2> { <urn:x> <urn:p> 1 } }",
        "INSERT DATA { GRAPH <urn:lab/graph/agent/nao\\u002D2> { <urn:x> <urn:p> 1 } }",
        "DELETE { GRAPH ?g { ?s ?p ?o } } WHERE { GRAPH ?g { ?s ?p ?o } }",
        f"INSERT {{ GRAPH ?g {{ <urn:x> <urn:p> 1 }} }} WHERE {{ BIND(IRI('{_OTHER}') AS ?g) }}",
        f"WITH <{_OTHER}> DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o }}",
        f"CLEAR GRAPH <{_OTHER}>",
        f"DROP SILENT GRAPH <{_OTHER}>",
        "CREATE GRAPH <urn:new>",
        f"COPY DEFAULT TO <{_OTHER}>",
        f"MOVE <{_OTHER}> TO DEFAULT",
        f"ADD DEFAULT TO <{_OTHER}>",
        "INSERT DATA { GRAPH <urn:lab/graph/shared> { <urn:x> <urn:p> 1 } }",
    ],
)
def test_a_robot_changes_nothing_but_its_own_graph(kb: KnowledgeBase, text: str) -> None:
    before = _outside(kb)
    with pytest.raises(ForbiddenError, match="robot nao-1 may not write") as caught:
        kb.update("INSERT DATA { <urn:first> <urn:p> 1 } ; " + text, agent="nao-1")
    assert caught.value.details["graph"].startswith("urn:")
    assert _outside(kb) == before
    assert kb.match("urn:first") == []


def test_statements_without_a_graph_go_to_the_robots_own(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:x> <urn:p> 1 }", agent="nao-1")
    assert [q.graph_name for q in kb.match("urn:x")] == [kb.graphs.agent("nao-1")]
    kb.update("DELETE WHERE { ?s <urn:p> ?o }", agent="nao-1")
    assert kb.match(graph=kb.graphs.agent("nao-1")) == []
    assert len(kb.match("urn:his")) == 1


def test_clearing_everything_clears_what_one_may_write(kb: KnowledgeBase) -> None:
    before = _outside(kb)
    kb.update("CLEAR ALL", agent="nao-1")
    assert _outside(kb) == before
    assert kb.match("urn:mine") == []
    kb.update("DROP NAMED", access=Access(None, "anonymous"))
    assert _outside(kb) == set()
    assert kb.match(graph=kb.graphs.provenance)


@pytest.mark.parametrize(
    "name", ["inferred", "meta", "provenance", "rules/nightly", "store", "union", "staged/1/0"]
)
def test_graphs_that_the_knowledge_base_keeps_are_closed_to_all(
    kb: KnowledgeBase, name: str
) -> None:
    text = f"INSERT DATA {{ GRAPH <urn:lab/graph/{name}> {{ <urn:x> <urn:p> 1 }} }}"
    for access in (Access(), Access(None, "anonymous"), Access("nao-1", "robot")):
        with pytest.raises(ForbiddenError) as caught:
            kb.update(text, access=access)
        assert caught.value.details["protected"] is True


def test_roles_differ_in_what_they_write(kb: KnowledgeBase) -> None:
    own, other, ontology = kb.graphs.agent("anna"), iri("urn:g"), iri("urn:onto")
    with kb.commit_block(_ontology_request(kb)) as tx:
        tx.add("urn:c", "urn:p", 1, graph=ontology)
    expected = {
        Access("anna", "reader"): (False, False, False),
        Access("anna", "robot"): (True, False, False),
        Access("anna", "teacher"): (True, False, False),
        Access(None, "anonymous"): (True, True, False),
        Access("anna", "admin"): (True, True, True),
    }
    for access, rights in expected.items():
        bound = kb.access(access=access)
        assert tuple(map(bound.may_write, (own, other, ontology))) == rights, access
    assert kb.may_write("nao-1", kb.graphs.agent("nao-1"))
    assert not kb.may_write("nao-1", other)


def _ontology_request(kb: KnowledgeBase) -> object:
    from rtask.kb.commit.commit import Request

    return Request(kb.access(), kinds={iri("urn:onto"): "OntologyGraph"})


def test_a_reader_writes_nothing(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError, match="reader"):
        kb.update("INSERT DATA { <urn:x> <urn:p> 1 }", access=Access(None, "reader"))


def test_a_plain_store_asks_only_whether_one_writes_at_all() -> None:
    with rtask.open(":memory:", plain=True) as kb:
        kb.update("INSERT DATA { <urn:x> <urn:p> 1 }", access=Access("nao-1", "robot"))
        with pytest.raises(ForbiddenError):
            kb.update("CLEAR ALL", access=Access(None, "reader"))


def test_load_is_switched_off(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError, match="LOAD is switched off"):
        kb.update("LOAD <http://127.0.0.1:1/x.ttl>")
    assert kb.update("LOAD SILENT <http://127.0.0.1:1/x.ttl>").added == 0


def test_rights_that_make_no_sense_are_refused() -> None:
    with pytest.raises(UsageError, match="unknown role"):
        Access("anna", "king")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="needs a name"):
        Access(None, "robot")
    with pytest.raises(UsageError, match="bind"):
        Access("nao-1", "robot").may_write(iri("urn:g"))


@pytest.mark.parametrize(
    ("named", "is_person"),
    [("robot/nao-2", False), ("robot/a%20b/hand", False), ("person/ann", True)],
)
def test_a_statement_tells_whether_a_person_or_a_robot_acted(
    kb: KnowledgeBase, named: str, is_person: bool
) -> None:
    quad = Quad(iri("urn:x"), iri(PREFIXES["rt"] + "performedBy"), iri(f"urn:lab/{named}"))
    name = unquote(named.split("/")[1])
    assert actor_of(quad, kb.graphs) == (is_person, name)
    elsewhere = Quad(quad.subject, quad.predicate, iri(f"urn:barn/{named}"))
    assert actor_of(elsewhere, kb.graphs) is None


@pytest.mark.parametrize("role", ["robot", "teacher"])
def test_nobody_states_what_somebody_else_did_whether_or_not_they_ever_wrote(
    kb: KnowledgeBase, role: Role
) -> None:
    caller = Access("kim", role)
    statement = f"INSERT DATA {{ <urn:x> <{PREFIXES['rt']}performedBy> <urn:lab/%s> }}"
    for own in ("robot/kim", "person/kim", f"person/{quote(unnamed_person('kim'))}"):
        assert kb.update(statement % own, access=caller).added == 1
    for other in ("robot/new", "person/ann", "person/operator"):
        with pytest.raises(ForbiddenError, match="the token belongs to 'kim'"):
            kb.update(statement % other, access=caller)


def test_hostile_names_stay_inside_their_graph(kb: KnowledgeBase) -> None:
    for name in ("../shared", "nao-2/x", "a b", 'x">', "ü", "%2e%2e"):
        kb.update("INSERT DATA { <urn:x> <urn:p> 1 }", agent=name)
        graph = kb.graphs.agent(name)
        assert graph.value.startswith("urn:lab/graph/agent/")
        assert "/" not in graph.value.removeprefix("urn:lab/graph/agent/")
        assert kb.graphs.owner(graph) == name
        assert kb.may_write(name, graph)
        assert not kb.may_write("nao-1", graph)
