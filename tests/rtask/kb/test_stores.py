"""What a knowledge base promises, wherever its statements are: memory, folder, SPARQL servers."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import ontology
import rtask
from rtask.errors import (
    DataError,
    ForbiddenError,
    InconsistentError,
    RemoteUnavailableError,
    RtaskError,
    UnsupportedError,
    UsageError,
    VersionConflictError,
)
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change
from rtask.kb.commit.inference import Inference
from rtask.kb.durability import saved_closures
from rtask.kb.store.writes import Writes
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import BlankNode, Literal, Quad, iri, literal, prologue
from rtask.remote import opening, transport
from rtask.remote.claim import Claim
from rtask.remote.dialect import Abilities
from rtask.remote.endpoints import Endpoints
from rtask.remote.head import Head, HeadGraph
from rtask.remote.probe import probe
from rtask.remote.store import RemoteStore
from tests import sparql_servers
from tests.sparql_servers import Oxigraph, SparqlServer, Virtuoso

pytestmark = pytest.mark.slow

_WITHOUT_OXIGRAPH = pytest.mark.skipif(
    sparql_servers.OXIGRAPH is None, reason="no oxigraph server; pip install oxigraph"
)
_WITHOUT_VIRTUOSO = pytest.mark.skipif(
    sparql_servers.VIRTUOSO is None, reason="no Virtuoso; apt-get install virtuoso-opensource"
)
_KINDS = [
    "memory",
    "folder",
    pytest.param("oxigraph", marks=_WITHOUT_OXIGRAPH),
    pytest.param("oxigraph-union", marks=_WITHOUT_OXIGRAPH),
    pytest.param("virtuoso", marks=_WITHOUT_VIRTUOSO),
]
_MAKERS: dict[str, Callable[[Path], SparqlServer]] = {
    "oxigraph": Oxigraph,
    "oxigraph-union": lambda folder: Oxigraph(folder, union=True),
    "virtuoso": Virtuoso,
}
_PREFIXES = prologue(ontology.PREFIXES)
_RT = ontology.NS


@pytest.fixture(scope="module", params=_KINDS)
def place(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., KnowledgeBase]]:
    """Return a function that opens an empty knowledge base, or the last one again."""
    kind: str = request.param
    root = tmp_path_factory.mktemp(kind)
    if kind in ("memory", "folder"):
        yield _Local(kind, root).open
        return
    server = _MAKERS[kind](root / "server")
    server.start()
    found: list[Abilities] = []

    def probe_once(endpoints: Endpoints) -> Abilities:
        if not found:
            found.append(probe(endpoints))
        return found[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opening, "probe", probe_once)  # it is the same server each time
        yield _OnServer(server, root).open
    server.kill()


class _Local:
    def __init__(self, kind: str, root: Path) -> None:
        self._kind = kind
        self._root = root
        self._numbers = itertools.count()
        self._last = 0

    def open(self, again: bool = False, **options: Any) -> KnowledgeBase:
        if self._kind == "memory":
            if again:
                pytest.skip("nothing is left of a store in memory")
            target: Any = ":memory:"
        else:
            self._last = self._last if again else next(self._numbers)
            target = self._root / str(self._last)
        return _opened(target, **{"base": "urn:lab/", **options})


class _OnServer:
    def __init__(self, server: SparqlServer, root: Path) -> None:
        self._server = server
        self._root = root
        self._numbers = itertools.count()
        self._last = 0

    def open(self, again: bool = False, **options: Any) -> KnowledgeBase:
        if not again:
            self._last = next(self._numbers)
            _empty(self._server)
        folder = options.pop("folder", self._root / f"local-{self._last}")
        return _opened(self._server.address, folder=folder, **{"base": "urn:lab/", **options})


def _opened(target: Any, **options: Any) -> KnowledgeBase:
    opened = rtask.open(target, **{"ontologies": False, "reason": False, **options})
    assert isinstance(opened, KnowledgeBase)
    return opened


def _empty(server: SparqlServer) -> None:
    with rtask.open(server.address, plain=True) as bare:
        rows = bare.select("SELECT DISTINCT ?g { GRAPH ?g { ?s ?p ?o } }")
        ours = [str(g) for (g,) in rows if "openlink" not in str(g) and "//localuri" not in str(g)]
        for graph in ours:
            if "/ns/ldp#" not in graph:
                bare.update(f"DROP SILENT GRAPH {graph}")
        with contextlib.suppress(RtaskError):  # some servers have no default graph
            bare.update("DROP SILENT DEFAULT")


@pytest.fixture
def kb(place: Callable[..., KnowledgeBase]) -> Iterator[KnowledgeBase]:
    with place() as opened:
        yield opened


def _texts(kb: KnowledgeBase, pattern: str) -> list[str]:
    return sorted(str(row[0]) for row in kb.select(f"SELECT ?x {{ {pattern} }}"))


def test_a_transaction_is_one_commit_with_an_owner(kb: KnowledgeBase) -> None:
    with kb.transaction(agent="nao-1", note="first sight") as tx:
        tx.add("urn:mug", "urn:mass", 0.3)
        tx.update("INSERT { ?s <urn:heavy> true } WHERE { ?s <urn:mass> ?m FILTER(?m > 0.2) }")
        tx.remove("urn:mug", "urn:mass", 0.3)
    assert (tx.commit.seq, tx.commit.added, tx.commit.removed) == (1, 1, 0)
    [quad] = kb.match("urn:mug")
    assert quad.graph_name == kb.graphs.agent("nao-1")
    assert quad.predicate == iri("urn:heavy")
    [entry] = kb.history("urn:mug")
    assert (entry.seq, entry.agent, entry.note) == (1, "nao-1", "first sight")
    assert _texts(kb, f"?a <{_RT}commitNumber> 1 . ?a a <{_RT}WriteActivity> BIND(?a AS ?x)") == [
        str(tx.commit.activity)
    ]


def test_an_exception_rolls_the_transaction_back(kb: KnowledgeBase) -> None:
    def write() -> None:
        with kb.transaction() as tx:
            tx.add("urn:mug", "urn:mass", 0.3)
            raise RuntimeError("the robot fell over")

    with pytest.raises(RuntimeError, match="fell over"):
        write()
    assert kb.match("urn:mug") == []
    assert kb.seq == 0
    kb.update("INSERT DATA { <urn:mug> <urn:mass> 1 }")  # the lock is free again


def test_the_union_counts_a_triple_once_however_many_graphs_hold_it(kb: KnowledgeBase) -> None:
    for agent in ("nao-1", "nao-2"):
        kb.update("INSERT DATA { <urn:mug> <urn:colour> 'red' }", agent)
    assert _texts(kb, "<urn:mug> <urn:colour> ?x") == ['"red"']
    assert len(kb.match("urn:mug")) == 2
    kb.update("DELETE DATA { <urn:mug> <urn:colour> 'red' }", "nao-1")
    assert _texts(kb, "<urn:mug> <urn:colour> ?x") == ['"red"']
    kb.update("DELETE DATA { <urn:mug> <urn:colour> 'red' }", "nao-2")
    assert _texts(kb, "<urn:mug> <urn:colour> ?x") == []


def test_named_graphs_can_be_asked_for(kb: KnowledgeBase) -> None:
    kb.update(
        "INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } GRAPH <urn:h> { <urn:a> <urn:p> 1 } }"
    )
    assert _texts(kb, "GRAPH ?x { <urn:a> <urn:p> 1 }") == ["<urn:g>", "<urn:h>"]
    rows = kb.select("SELECT ?x { ?x <urn:p> 1 }", default_graphs=["urn:g"])
    assert [str(x) for (x,) in rows] == ["<urn:a>"]
    assert not kb.select("SELECT ?x { ?x <urn:p> 1 }", default_graphs=["urn:none"])
    kb.update("DROP GRAPH <urn:g>")
    assert _texts(kb, "GRAPH ?x { <urn:a> <urn:p> 1 }") == ["<urn:h>"]
    kb.update("MOVE <urn:h> TO <urn:i>")
    assert _texts(kb, "GRAPH ?x { <urn:a> <urn:p> 1 }") == ["<urn:i>"]
    with pytest.raises(DataError, match="does not exist"):
        kb.update("CLEAR GRAPH <urn:h>")


def test_a_variable_for_graphs_ranges_over_those_of_the_knowledge_base(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } <urn:a> <urn:q> 2 }")
    theirs = "GRAPH <urn:somebody> { <urn:a> <urn:p> 1 }"
    if isinstance(kb.store, RemoteStore):  # another program's graph on the same server
        kb.store.endpoints.update(f"INSERT DATA {{ {theirs} }}")
    known = sorted(str(graph) for graph in kb.store.named_graphs() if kb.store.count(graph))
    try:
        assert _texts(kb, "{ SELECT DISTINCT ?x { GRAPH ?x { ?s ?p ?o } } }") == known
        assert _texts(kb, "GRAPH ?x { <urn:a> <urn:p> ?o }GRAPH $x { ?s <urn:p> 1 }") == ["<urn:g>"]
        nested = "?s <urn:q> 2 FILTER EXISTS { GRAPH ?g { ?s <urn:p> 1 } } BIND(?s AS ?x)"
        assert _texts(kb, nested) == ["<urn:a>"]
        found = kb.query("CONSTRUCT { ?g <urn:holds> ?s } { GRAPH ?g { ?s <urn:p> 1 } }")
        assert [str(triple.subject) for triple in found] == ["<urn:g>"]
    finally:
        if isinstance(kb.store, RemoteStore):
            kb.store.endpoints.update(f"DELETE DATA {{ {theirs} }}")


_VALUES = [
    literal(3), literal(-(2**53) - 1), literal(0.1), literal(True), literal("Becher \\ \" \n ☕"),
    Literal("mug", language="en"), Literal("2.5", datatype=iri(rtask.rdf.terms.XSD + "decimal")),
    Literal("3", datatype=iri(rtask.rdf.terms.XSD + "decimal")),
    Literal("2026-01-02T03:04:05.25Z", datatype=iri(rtask.rdf.terms.XSD + "dateTime")),
    Literal("PT1M30S", datatype=iri(rtask.rdf.terms.XSD + "duration")),
    Literal("POINT(1 2)", datatype=iri("http://www.opengis.net/ont/geosparql#wktLiteral")),
    iri("urn:x#é"),
]  # fmt: skip


def test_values_come_back_as_they_were_given_and_can_be_removed(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        for value in _VALUES:
            tx.add("urn:a", "urn:p", value)
    assert {q.object for q in kb.match("urn:a")} == set(_VALUES)
    assert {row[0] for row in kb.select("SELECT ?x { <urn:a> <urn:p> ?x }")} == set(_VALUES)
    with kb.transaction() as tx:
        for value in _VALUES:
            tx.remove("urn:a", "urn:p", value)
    assert tx.commit.removed == len(_VALUES)
    assert kb.match("urn:a") == []


_HOSTILE = [
    Literal("urn:rtask:as:no datatype"), Literal("urn:rtask:as:"),
    Literal("urn:rtask:as:urn:x 1", language="en"),
    iri("urn:lab/.well-known/genid/_/a/b"), iri("urn:lab/.well-known/genid/_/"),
]  # fmt: skip


def test_values_that_look_like_those_on_their_way_to_a_server_come_back(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        for value in _HOSTILE:
            tx.add("urn:a", "urn:p", value)
    assert {q.object for q in kb.match("urn:a")} == set(_HOSTILE)
    assert {row[0] for row in kb.select("SELECT ?x { <urn:a> <urn:p> ?x }")} == set(_HOSTILE)
    found = kb.query("CONSTRUCT WHERE { <urn:a> <urn:p> ?x }")
    assert {triple.object for triple in found} == set(_HOSTILE)
    with kb.transaction() as tx:
        for value in _HOSTILE:
            tx.remove("urn:a", "urn:p", value)
    assert kb.match("urn:a") == []


def test_blank_nodes_keep_their_names(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> [ <urn:q> 1, 2 ] } }")
    [quad] = kb.match("urn:a")
    assert isinstance(quad.object, BlankNode)
    assert len(kb.match(quad.object)) == 2
    assert len(kb.select("SELECT ?x { <urn:a> <urn:p>/<urn:q> ?x }")) == 2
    [row] = kb.select("SELECT ?x { <urn:a> <urn:p> ?x }")
    assert row[0] == quad.object
    with kb.transaction() as tx:
        tx.remove("urn:a", "urn:p", quad.object, "urn:g")
    assert kb.match("urn:a") == []


def test_rights_hold(kb: KnowledgeBase) -> None:
    robot = Access("nao-1", "robot")
    with pytest.raises(ForbiddenError, match="nao-1"):
        kb.update("INSERT DATA { GRAPH <urn:lab/graph/agent/nao-2> { <urn:a> <urn:p> 1 } }",
                  access=robot)  # fmt: skip
    with pytest.raises(ForbiddenError, match="only the knowledge base itself"):
        kb.update("INSERT DATA { GRAPH <urn:lab/graph/meta> { <urn:a> <urn:p> 1 } }")
    assert kb.seq == 0


def test_a_version_can_be_required(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", if_version=0)
    with pytest.raises(VersionConflictError):
        kb.update("INSERT DATA { <urn:a> <urn:p> 2 }", if_version=0)
    assert _texts(kb, "<urn:a> <urn:p> ?x") == [str(literal(1))]


def test_commits_are_announced_and_searched(kb: KnowledgeBase) -> None:
    heard: list[Change] = []
    kb.on_commit(heard.append)
    with kb.transaction() as tx:
        tx.add("urn:mug", "http://www.w3.org/2000/01/rdf-schema#label", literal("red coffee mug"))
    assert [change.commit.seq for change in heard] == [1]
    assert [str(hit.subject) for hit in kb.search("coffee")] == ["<urn:mug>"]


def test_blobs_are_kept_and_missing_ones_refused(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        name = tx.blob(b"a picture", "image/png")
    assert kb.blobs.read(name) == b"a picture"
    with pytest.raises(RtaskError, match="not stored here"), kb.transaction() as tx:
        tx.add("urn:a", "urn:p", iri("urn:sha256:" + "0" * 64))


def test_what_was_stored_is_there_after_opening_again(place: Callable[..., KnowledgeBase]) -> None:
    with place() as kb:
        for number in range(3):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}", "nao-1")
        before = kb.stats()
    with place(again=True) as kb:
        assert kb.seq == 3
        after = kb.stats()
        assert {k: after[k] for k in ("triples", "asserted", "graphs", "commits")} == {
            k: before[k] for k in ("triples", "asserted", "graphs", "commits")
        }
        assert [entry.seq for entry in kb.history("urn:a")] == [1, 2, 3]
        kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
        assert kb.seq == 4


def test_a_change_of_many_statements_is_one_commit(kb: KnowledgeBase) -> None:
    """More than one request of any server holds."""
    count = 6_000
    with kb.transaction() as tx:
        for number in range(count):
            tx.add(f"urn:s{number % 50}", "urn:p", number, "urn:big")
    assert (tx.commit.seq, tx.commit.added) == (1, count)
    [row] = kb.select("SELECT (COUNT(*) AS ?n) { GRAPH <urn:big> { ?s ?p ?o } }")
    assert int(str(row.value("n"))) == count
    kb.update("CLEAR GRAPH <urn:big>")
    assert not kb.query("ASK { ?s <urn:p> ?o }")


def test_readmes_calls_with_reasoning_contradictions_and_quarantine(
    place: Callable[..., KnowledgeBase],
) -> None:
    with place(reason=True, on_inconsistency="quarantine") as kb:
        kb.load(_PREFIXES.replace("PREFIX", "@prefix").replace(">", "> .").encode() + b"""
            rt:Mug a owl:Class ; rdfs:subClassOf rt:Vessel .
            rt:Vessel owl:disjointWith rt:Robot .
            """, format="turtle", graph="urn:lab/graph/import/tbox")  # fmt: skip
        with kb.transaction(agent="nao-1") as tx:
            tx.add("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Mug"))
        assert tx.commit.derived == 1
        assert kb.query(f"ASK {{ <urn:mug> a <{_RT}Vessel> }}") is True
        assert not kb.query(f"ASK {{ <urn:mug> a <{_RT}Vessel> }}", inferred=False)
        assert kb.explain("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Vessel")) is not None
        with kb.transaction(agent="nao-2") as tx:
            tx.add("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Robot"))
            tx.add("urn:mug", "urn:mass", 0.3)
        assert tx.commit.quarantined == 1
        assert len(kb.quarantined()) == 1
        with kb.transaction(agent="nao-1") as tx:
            tx.remove("urn:mug", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Mug"))
        assert kb.query(f"ASK {{ <urn:mug> a <{_RT}Vessel> }}") is False
    with place(again=True, reason=True) as kb:
        with kb.transaction() as tx:
            tx.add("urn:cup", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Mug"))
        assert tx.commit.derived == 1
        with pytest.raises(InconsistentError), kb.transaction() as tx:
            tx.add("urn:cup", rtask.rdf.terms.RDF_TYPE, iri(_RT + "Robot"))


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[Inference]:
    """Return a list to which each building of a closure from all statements is added."""
    found: list[Inference] = []
    build = Inference._build

    def noted(self: Inference) -> Any:
        found.append(self)
        return build(self)

    monkeypatch.setattr(Inference, "_build", noted)
    monkeypatch.setattr(saved_closures, "_MIN_ASSERTED", 0)
    return found


_TBOX = (
    b"@prefix : <urn:t:> . @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .\n"
    b":Mug rdfs:subClassOf :Vessel . :Vessel rdfs:subClassOf :Thing ."
)


def test_the_closure_is_there_after_opening_again(
    place: Callable[..., KnowledgeBase], built: list[Inference], monkeypatch: pytest.MonkeyPatch
) -> None:
    with place(reason=True) as kb:
        kb.load(_TBOX, format="turtle", graph="urn:lab/graph/import/tbox")
        kb.update("INSERT DATA { <urn:m0> a <urn:t:Mug> }", "nao-1")
    built.clear()
    with monkeypatch.context() as patch, place(again=True, reason=True) as kb:
        patch.setattr(Inference, "prepare_save", lambda _: None)  # as if it were killed later
        kb.update("DELETE DATA { <urn:m0> a <urn:t:Mug> }", "nao-1")
        kb.update("INSERT DATA { <urn:m1> a <urn:t:Mug> }", "nao-1")
        kb.close()
    with place(again=True, reason=True) as kb:
        with kb.transaction(agent="nao-1") as tx:
            tx.add("urn:m2", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Mug"))
        assert tx.commit.derived == 2
        assert kb.explain("urn:m1", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing")) is not None
        assert kb.explain("urn:m0", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing")) is None
    assert built == []


# Only on servers


def test_the_closure_follows_what_other_processes_commit(
    place: Callable[..., KnowledgeBase], built: list[Inference], tmp_path: Path
) -> None:
    with place(reason=True) as one:
        _remote(one)
        one.load(_TBOX, format="turtle", graph="urn:lab/graph/import/tbox")
        with place(again=True, reason=True, folder=tmp_path / "other") as two:
            two.update("INSERT DATA { <urn:m0> a <urn:t:Mug> }", "nao-2")
            built.clear()
            for number in range(1, 4):
                one.update(f"INSERT DATA {{ <urn:m{number}> a <urn:t:Mug> }}", "nao-1")
                two.update(f"DELETE DATA {{ <urn:m{number - 1}> a <urn:t:Mug> }}", "nao-1")
            assert _texts(two, "?x a <urn:t:Thing>") == ["<urn:m0>", "<urn:m3>"]
            for kb in (one, two):
                assert not kb.explain("urn:m1", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing"))
                missing, surplus = kb._reasoner().difference()
                assert (list(missing), surplus) == ([], [])
            assert len(built) == 2  # by asking for the difference


def _remote(kb: KnowledgeBase) -> RemoteStore:
    if not isinstance(kb.store, RemoteStore):
        pytest.skip("only on servers")
    return kb.store


def test_a_commit_takes_at_most_four_requests(kb: KnowledgeBase) -> None:
    connection = _remote(kb).endpoints.connection
    for number in range(3):
        before, started = connection.requests, time.monotonic()
        with kb.transaction(agent="nao-1") as tx:
            for at in range(40):
                tx.add(f"urn:s{number}-{at}", "urn:p", at)
        sent = connection.requests - before
        # more may come from the look for commits of others, once a second
        assert sent <= 4 + 1 + int(time.monotonic() - started)


def test_two_processes_over_one_server_see_each_other_and_never_overwrite(
    place: Callable[..., KnowledgeBase], tmp_path: Path
) -> None:
    with place() as one:
        _remote(one)
        with place(again=True, folder=tmp_path / "other") as two:
            heard = threading.Event()
            two.on_commit(lambda change: heard.set() if change.agent == "nao-1" else None)
            one.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-1")
            two.update("INSERT DATA { <urn:a> <urn:p> 2 }", "nao-2")
            one.update("INSERT DATA { <urn:a> <urn:p> 3 }", "nao-1")
            assert heard.wait(20.0)
            assert one.seq == 3
            assert len(two.match("urn:a")) == 3

            failed: list[Exception] = []

            def add(kb: KnowledgeBase, agent: str) -> None:
                for number in range(15):
                    # Some hundred statements keep a server busy long enough for both to meet.
                    more = " . ".join(f"<urn:{agent}-{number}> <urn:r> {n}" for n in range(300))
                    text = f"INSERT DATA {{ <urn:b> <urn:{agent}> {number} . {more} }}"
                    while True:
                        with contextlib.suppress(VersionConflictError):
                            kb.update(text, agent)
                            break

            def run(kb: KnowledgeBase, agent: str) -> None:
                try:
                    add(kb, agent)
                except RtaskError as error:
                    failed.append(error)

            threads = [threading.Thread(target=run, args=pair)
                       for pair in ((one, "nao-1"), (two, "nao-2"))]  # fmt: skip
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert not failed
            assert len(one.match("urn:b")) == 30
            assert len(one.match(None, "urn:r")) == 30 * 300
            numbers = one.select(
                f"SELECT ?n {{ ?a a <{_RT}WriteActivity> ; <{_RT}commitNumber> ?n }}"
            )
            assert sorted(int(str(r.value("n"))) for r in numbers) == list(range(1, 34))


def test_of_commits_at_the_same_moment_one_is_stored(kb: KnowledgeBase) -> None:
    """Also on servers whose updates do not see each other, as Oxigraph's and Virtuoso's."""
    store = _remote(kb)
    graphs = [HeadGraph(store.endpoints, store.dialect) for _ in range(2)]
    for number in range(12):
        old, together = store.read_head(), threading.Barrier(2)
        stored: list[Head] = []

        def commit(
            which: int,
            old: Head = old,
            together: threading.Barrier = together,
            stored: list[Head] = stored,
            number: int = number,
        ) -> None:
            new = old.next(f"{number}-{which}")
            name = iri(f"urn:s{number}-{which}")
            quads = [Quad(name, iri("urn:p"), literal(n), iri("urn:g")) for n in range(300)]
            together.wait()
            with contextlib.suppress(VersionConflictError):
                graphs[which].replace(old, new, Writes({}, dict.fromkeys(quads)), None)
                stored.append(new)

        threads = [threading.Thread(target=commit, args=(which,)) for which in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert stored == [store.read_head()]
        assert store.count(iri("urn:g")) == 300 * (number + 1)


def test_a_claim_that_a_killed_process_left_does_not_stop_others_for_good(
    kb: KnowledgeBase,
) -> None:
    name = "<urn:lab/graph/store>"
    claim = f'GRAPH {name} {{ {name} <urn:rtask:store:claim> "somebody:1:2" }}'  # for 2 s
    _remote(kb).endpoints.update(f"INSERT DATA {{ {claim} }}")
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    assert kb.seq == 1
    assert not _remote(kb).endpoints.ask(f"ASK {{ {claim} }}")
    left = f"ASK {{ GRAPH {name} {{ ?s <urn:rtask:store:claim> ?c }} }}"
    assert not _remote(kb).endpoints.ask(left)


_CLAIMS = "<urn:lab/graph/store>"


class _Watched(Endpoints):
    """Does something before or after certain updates, as another process might."""

    def __init__(self, endpoints: Endpoints, meddle: Callable[[Endpoints, int], None]) -> None:
        super().__init__(endpoints.query_url, endpoints.update_url, endpoints.connection)
        self.claimed: list[str] = []
        self._meddle = meddle

    def update(self, text: str) -> None:
        super().update(text)
        if text.startswith("INSERT DATA"):
            self.claimed.append(text)
            self._meddle(self, len(self.claimed))


def test_a_claim_that_others_removed_is_made_again(kb: KnowledgeBase) -> None:
    def remove(endpoints: Endpoints, number: int) -> None:
        if number == 1:  # as if the answer had taken so long that others took it for a left one
            endpoints.update(
                f"DELETE WHERE {{ GRAPH {_CLAIMS} {{ ?s <urn:rtask:store:claim> ?c }} }}"
            )

    endpoints = _Watched(_remote(kb).endpoints, remove)
    claim = Claim(endpoints, _CLAIMS)
    claim.take("?s ?p ?h FILTER(false)", lambda _: None, 20)
    assert endpoints.ask(f"ASK {{ {claim.pattern} }}")
    claim.release()
    assert not endpoints.ask(f"ASK {{ {claim.pattern} }}")


def test_no_claim_looks_like_an_earlier_one_that_was_withdrawn(kb: KnowledgeBase) -> None:
    theirs = f'GRAPH {_CLAIMS} {{ {_CLAIMS} <urn:rtask:store:claim> "somebody:1:600" }}'

    def withdraw(endpoints: Endpoints, number: int) -> None:
        if number == 3:
            endpoints.update(f"DELETE DATA {{ {theirs} }}")

    _remote(kb).endpoints.update(f"INSERT DATA {{ {theirs} }}")
    endpoints = _Watched(_remote(kb).endpoints, withdraw)
    claim = Claim(endpoints, _CLAIMS)
    claim.take("?s ?p ?h FILTER(false)", lambda _: None, 20)
    claim.release()
    assert len(set(endpoints.claimed)) == len(endpoints.claimed) == 3


def test_a_process_does_not_overtake_its_own_commit_that_got_no_answer(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoints = _remote(kb).endpoints
    claim = Claim(endpoints, _CLAIMS)
    claim.take("?s ?p ?h FILTER(false)", lambda _: None, 600)
    sent = claim.pattern
    claim.keep()
    with monkeypatch.context() as patch:
        patch.setattr(endpoints.connection, "timeout_s", 0.0)  # one attempt
        with pytest.raises(RemoteUnavailableError, match="have not ended"):
            claim.take("?s ?p ?h FILTER(false)", lambda _: None, 20)
    assert endpoints.ask(f"ASK {{ {sent} }}")
    endpoints.update(f"DELETE DATA {{ {sent} }}")  # as the commit itself does
    claim.take("?s ?p ?h FILTER(false)", lambda _: None, 20)
    claim.release()


def test_commits_of_others_are_taken_in_after_a_request_for_them_failed(
    place: Callable[..., KnowledgeBase], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with place(reason=True) as one:
        _remote(one)
        one.load(_TBOX, format="turtle", graph="urn:lab/graph/import/tbox")
        with place(again=True, reason=True, folder=tmp_path / "other") as two:
            two.update("INSERT DATA { <urn:m0> a <urn:t:Mug> }", "nao-2")
            sync = _remote(two).on_moved.__self__  # type: ignore[attr-defined]

            def fail(_: int = 0) -> Any:
                raise RemoteUnavailableError("away")

            with monkeypatch.context() as patch:
                patch.setattr(sync._journal, "records", fail)
                one.update("INSERT DATA { <urn:m1> a <urn:t:Mug> }", "nao-1")
                with contextlib.suppress(RemoteUnavailableError):
                    sync.look()
            sync.look()
            thing = (rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing"))
            assert two.explain("urn:m1", *thing) is not None


def test_what_a_server_cannot_do_is_said_plainly(kb: KnowledgeBase, tmp_path: Path) -> None:
    _remote(kb)
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with pytest.raises(UnsupportedError):
        kb.backup(tmp_path / "backup")
    with pytest.raises((UnsupportedError, UsageError)):
        kb.as_of(0)
    if not _remote(kb).dialect.abilities.triple_terms:
        with pytest.raises(UnsupportedError, match="triple terms"), kb.transaction() as tx:
            tx.add("urn:a", "urn:p", 2, confidence=0.5)
    assert kb.seq == 1


@pytest.mark.parametrize("kind", _KINDS[2:])
def test_a_server_killed_under_load_loses_nothing_and_keeps_nothing_half(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport, "_PAUSE_S", 0.01)
    server = _MAKERS[kind](tmp_path / "server")
    server.start()
    acknowledged: list[int] = []
    stop = threading.Event()

    def write(kb: KnowledgeBase) -> None:
        for number in itertools.count():
            if stop.is_set():
                return
            try:
                with kb.transaction(agent="nao-1") as tx:
                    for part in range(5):
                        tx.add(f"urn:{number}", f"urn:p{part}", number)
            except (RemoteUnavailableError, VersionConflictError):
                continue
            acknowledged.append(number)

    options: dict[str, Any] = {"base": "urn:lab/", "timeout_s": 20.0, "folder": tmp_path / "local"}
    try:
        with _opened(server.address, **options) as kb:
            writer = threading.Thread(target=write, args=(kb,))
            writer.start()
            for _ in range(3):
                enough = len(acknowledged) + 10
                _wait_for(lambda enough=enough: len(acknowledged) >= enough)
                server.kill()
                server.start()
            enough = len(acknowledged) + 10
            _wait_for(lambda: len(acknowledged) >= enough)  # it goes on by itself
            stop.set()
            writer.join(60)
            seq = kb.seq
        with _opened(server.address, **options) as kb:
            assert kb.seq == seq
            ours = "?s ?p ?o FILTER(STRSTARTS(STR(?p), 'urn:p'))"
            rows = kb.select(f"SELECT ?s (COUNT(*) AS ?n) {{ {ours} }} GROUP BY ?s")
            sizes = {int(str(r.value("s")).split(":")[1]): int(str(r.value("n"))) for r in rows}
            assert set(acknowledged) <= set(sizes)
            assert set(sizes.values()) == {5}
            assert len(sizes) == seq == len(kb.history(graph=kb.graphs.agent("nao-1")))
    finally:
        stop.set()
        server.kill()


def _wait_for(condition: Callable[[], bool]) -> None:
    waited = threading.Event()
    for _ in range(1_200):
        if condition():
            return
        waited.wait(0.05)
    pytest.fail("it did not go on within a minute")
