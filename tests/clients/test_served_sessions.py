"""Python objects over the address of a server: what holds in one process holds there."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import httpx
import pytest

import ontology
import rtask
from rtask.errors import ForbiddenError, RemoteError, UnsupportedError, VersionConflictError
from rtask.model import RTASK
from rtask.remote.served import ServedKnowledgeBase
from tests.rtask.model import (
    test_orm_answers,
    test_orm_conveniences,
    test_orm_queries,
    test_orm_sessions,
)
from tests.rtask.model.conftest import furnish
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

RT = ontology.NS


def same_tests(*modules: ModuleType) -> list[Any]:
    """Return the tests of other modules that need a knowledge base and nothing else.

    Of each module every third runs always: over an address a test takes ten times as long, and all
    of them go through the same few requests.
    """
    found = []
    for module in modules:
        count = 0
        for name, test in inspect.getmembers(module, inspect.isfunction):
            needs = set(inspect.signature(test).parameters)
            if name.startswith("test_") and len(needs) == 1 and needs <= {"kb", "lab", "still_lab"}:
                marks = () if count % 3 == 0 else pytest.mark.deep
                found.append(pytest.param(test, *needs, id=name.removeprefix("test_"), marks=marks))
                count += 1
    return found


def opened(server: RunningServer, **options: Any) -> ServedKnowledgeBase:
    kb = rtask.open(server.url + "/sparql", **options)
    assert isinstance(kb, ServedKnowledgeBase)
    return kb


@pytest.fixture(scope="module")
def served(server: RunningServer) -> Iterator[ServedKnowledgeBase]:
    with opened(server) as kb:
        yield kb


@pytest.fixture
def kb(served: ServedKnowledgeBase) -> ServedKnowledgeBase:
    """Return a knowledge base with the ontology only."""
    graphs = served.select(
        "SELECT DISTINCT ?g { GRAPH ?g { ?s ?p ?o } FILTER(STRSTARTS(STR(?g), ?start)) }",
        bindings={"start": served.base + "graph/"},
    )
    for (graph,) in graphs:
        if not served.graphs.is_system(graph):  # type: ignore[arg-type]
            served.update(f"DROP GRAPH {graph}")
    return served


@pytest.fixture
def lab(kb: ServedKnowledgeBase) -> ServedKnowledgeBase:
    return furnish(kb)


@pytest.fixture
def other(server: RunningServer) -> Iterator[ServedKnowledgeBase]:
    """Another program at the same server."""
    with opened(server) as kb:
        yield kb


def masses(kb: ServedKnowledgeBase) -> list[float]:
    quads = kb.match(kb.base + "object/1", RT + "mass")
    return sorted(float(quad.object.value) for quad in quads)  # type: ignore[union-attr]


def weigh(kb: ServedKnowledgeBase, mass: float, thing: str = "object/1") -> None:
    with kb.session(agent="nao-1") as s:
        s.get(RTASK.ManipulableObject, kb.base + thing).mass = mass


@pytest.mark.parametrize(
    ("test", "needs"),
    same_tests(test_orm_sessions, test_orm_queries, test_orm_answers, test_orm_conveniences),
)
def test_as_in_one_process(test: Callable[..., None], needs: str, kb: ServedKnowledgeBase) -> None:
    test(kb if needs == "kb" else furnish(kb))


def test_commits_of_other_programs_show_with_the_next_answer(
    lab: ServedKnowledgeBase, other: ServedKnowledgeBase
) -> None:
    with lab.session() as s:
        mug, pen = (s.get(RTASK.ManipulableObject, f"{lab.base}object/{n}") for n in (1, 2))
        weigh(other, 0.4)
        assert mug.mass == 0.3  # nothing was asked since
        assert s.query(RTASK.Robot).exists()
        assert s.get(RTASK.ManipulableObject, mug.iri) is mug
        assert mug.mass == 0.4
        assert pen.__state__.is_read  # it was not concerned


def test_after_many_commits_everything_is_read_again(
    lab: ServedKnowledgeBase, other: ServedKnowledgeBase
) -> None:
    with lab.session() as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        weigh(other, 0.4)
        for number in range(25):
            other.update(f"INSERT DATA {{ <urn:thing> <urn:number> {number} }}")
        assert s.query(RTASK.Robot).exists()
        assert s.get(RTASK.Mug, mug.iri).mass == 0.4


def between(
    monkeypatch: pytest.MonkeyPatch, kb: ServedKnowledgeBase, act: Callable[[], None]
) -> list[str]:
    """Let ``act`` happen between what a session reads and its first update."""
    write, updates = kb.write_if, list[str]()

    def late(version: str, text: str, *author: str | None) -> Any:
        updates.append(text)
        if len(updates) == 1:
            act()
        return write(version, text, *author)

    monkeypatch.setattr(kb, "write_if", late)
    return updates


def test_a_commit_at_the_last_moment_is_not_overwritten(
    lab: ServedKnowledgeBase, other: ServedKnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    updates = between(monkeypatch, lab, lambda: weigh(other, 0.4))
    with pytest.raises(VersionConflictError, match="changed by somebody else"):
        weigh(lab, 0.5)
    assert len(updates) == 1
    assert masses(lab) == [0.4]


def test_a_commit_about_something_else_at_the_last_moment_does_no_harm(
    lab: ServedKnowledgeBase, other: ServedKnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    updates = between(monkeypatch, lab, lambda: weigh(other, 0.02, "object/2"))
    weigh(lab, 0.5)
    assert len(updates) == 2
    assert masses(lab) == [0.5]


def test_programs_that_count_at_once_lose_nothing(
    lab: ServedKnowledgeBase, server: RunningServer
) -> None:
    weigh(lab, 1.0)

    def count() -> None:
        with opened(server) as kb:
            done = 0
            while done < 5:
                try:
                    with kb.session(agent="nao-1") as s:
                        mug = s.get(RTASK.Mug, kb.base + "object/1")
                        assert mug.mass is not None
                        mug.mass += 1.0
                except VersionConflictError:
                    continue
                done += 1

    threads = [threading.Thread(target=count) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert masses(lab) == [16.0]


def test_the_record_says_who_wrote_and_why(lab: ServedKnowledgeBase) -> None:
    with lab.session(agent="nao-1", note="weighed again") as s:
        s.get(RTASK.Mug, lab.base + "object/1").mass = 0.32
        commit = s.flush()
    assert commit is not None
    assert commit.activity is not None
    assert (commit.seq, commit.added, commit.removed) == (lab.seq, 1, 1)
    text = "ASK { ?activity ?says ?note FILTER(CONTAINS(STR(?note), 'weighed again')) }"
    assert lab.query(text, bindings={"activity": commit.activity}) is True


def test_a_session_goes_on_after_the_server_started_anew(
    lab: ServedKnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    with lab.session(agent="nao-1") as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        assert mug.mass == 0.3
        monkeypatch.setattr(lab._commits, "_version", "old:5")
        monkeypatch.setattr(lab._commits, "_awaited", "old:5")  # as after an own write
        with pytest.raises(RemoteError, match="renumbered"):
            s.query(RTASK.Robot).exists()
        assert s.query(RTASK.Robot).exists()
        assert s.get(RTASK.Mug, mug.iri) is mug
        mug.mass = 0.4
    assert masses(lab) == [0.4]


def test_classes_of_a_loaded_ontology_and_lists(kb: ServedKnowledgeBase) -> None:
    kb.load(
        b"""@prefix : <https://example.org/kitchen#> . @prefix rt: <https://w3id.org/rtask-kg/ns#> .
        @prefix owl: <http://www.w3.org/2002/07/owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        <https://example.org/kitchen> a owl:Ontology .
        :Teapot a owl:Class ; rdfs:subClassOf rt:Container .
        :recipe a owl:ObjectProperty ; rdfs:domain :Teapot ;
            rdfs:range <http://www.w3.org/1999/02/22-rdf-syntax-ns#List> .""",
        "turtle",
        graph="https://example.org/kitchen",
    )
    kitchen = kb.model("https://example.org/kitchen")
    with kb.session(agent="ann") as s:
        s.add(kitchen.Teapot(iri="urn:pot", object_id="kitchen/pot-1", recipe=["boil", "pour"]))
    with kb.session(agent="ann") as s:
        pot = s.query(kitchen.Teapot).one()
        assert pot.recipe == ("boil", "pour")
        pot.recipe = ["pour", "wait", "drink"]
    with kb.session() as s:
        assert s.query(RTASK.Container).one().recipe == ("pour", "wait", "drink")  # type: ignore[attr-defined]
    cells = kb.match(predicate=ontology.PREFIXES["rdf"] + "rest", graph=kb.graphs.agent("ann"))
    assert len(cells) == 3  # nothing is left of the list before
    kb.update("DROP GRAPH <https://example.org/kitchen>")


def test_who_shows_a_token_writes_in_its_own_name(
    guarded: RunningServer, make_token: Callable[..., str]
) -> None:
    with opened(guarded, token=make_token("--robot", "nao-1")) as kb:
        with kb.session(agent="nao-1") as s:
            s.add(RTASK.Mug(iri="urn:mug", object_id="lab/mug-1"))
        (quad,) = kb.match("urn:mug", RT + "objectId")
        assert quad.graph_name == kb.graphs.agent("nao-1")
        for agent in ("nao-2", None):
            with pytest.raises(ForbiddenError), kb.session(agent) as s:
                s.add(RTASK.Mug(object_id="lab/mug-2"))


def test_a_bare_dataset_has_no_sessions() -> None:
    with running_server(None, "--profile", "plain") as server, opened(server) as kb:
        with pytest.raises(UnsupportedError, match="no graphs of agents"):
            kb.session()
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True


def test_a_change_can_depend_on_a_version(client: httpx.Client) -> None:
    def write(version: str) -> httpx.Response:
        update = "INSERT DATA { <urn:mug> <urn:seen> 1 }"
        return client.post("/update", data={"update": update, "if-version": version})

    now = client.post("/sparql", data={"query": "ASK {}"}).headers["RTASK-Version"]
    epoch, _, number = now.partition(":")
    assert write(f"{epoch}:{int(number) - 1}").json()["type"] == "/errors/version-conflict"
    assert write(f"other:{number}").status_code == 412
    assert write("yesterday").status_code == 400
    ask = {"query": "ASK { <urn:mug> <urn:seen> 1 }"}
    assert client.post("/sparql", data=ask).json()["boolean"] is False
    assert write(now).status_code == 204
    assert client.post("/sparql", data=ask).json()["boolean"] is True
