"""Commits on a SPARQL server: the head, claims, other processes, servers that are killed."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ontology
import rtask
from rtask.errors import (
    CallFailedError,
    RemoteUnavailableError,
    RtaskError,
    UnsupportedError,
    UsageError,
    VersionConflictError,
)
from rtask.kb.commit.inference import Inference
from rtask.kb.store.writes import Writes
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Quad, iri, literal, prologue
from rtask.remote import head, sync, transport
from rtask.remote.claim import Claim
from rtask.remote.endpoints import Endpoints
from rtask.remote.head import Head, HeadGraph, remove_left_behind
from tests.rtask.remote.places import KINDS, MAKERS, TBOX, opened, remote_store, texts

pytestmark = pytest.mark.slow

_PREFIXES = prologue(ontology.PREFIXES)
_RT = ontology.NS
_CLAIMS = "<urn:lab/graph/store>"


def test_the_closure_follows_what_other_processes_commit(
    place: Callable[..., KnowledgeBase], built: list[Inference], tmp_path: Path
) -> None:
    with place(reason=True) as one:
        remote_store(one)
        one.load(TBOX, format="turtle", graph="urn:lab/graph/import/tbox")
        with place(again=True, reason=True, folder=tmp_path / "other") as two:
            two.update("INSERT DATA { <urn:m0> a <urn:t:Mug> }", "nao-2")
            built.clear()
            for number in range(1, 4):
                one.update(f"INSERT DATA {{ <urn:m{number}> a <urn:t:Mug> }}", "nao-1")
                two.update(f"DELETE DATA {{ <urn:m{number - 1}> a <urn:t:Mug> }}", "nao-1")
            assert texts(two, "?x a <urn:t:Thing>") == ["<urn:m0>", "<urn:m3>"]
            for kb in (one, two):
                assert not kb.explain("urn:m1", rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing"))
                missing, surplus = kb._reasoner().difference()
                assert (list(missing), surplus) == ([], [])
            assert len(built) == 2  # by asking for the difference


def test_a_commit_takes_at_most_four_requests(
    place: Callable[..., KnowledgeBase], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sync, "EVERY_S", 3600.0)  # the look for commits of others
    with place() as kb:
        connection = remote_store(kb).endpoints.connection
        for number in range(3):
            before = connection.requests
            with kb.transaction(agent="nao-1") as tx:
                for at in range(40):
                    tx.add(f"urn:s{number}-{at}", "urn:p", at)
            # The first one in a new place reads twice more, once the keys.
            assert connection.requests - before <= (4 if number else 6)


def test_two_processes_over_one_server_see_each_other_and_never_overwrite(
    place: Callable[..., KnowledgeBase], tmp_path: Path
) -> None:
    with place() as one:
        remote_store(one)
        with place(again=True, folder=tmp_path / "other") as two:
            heard = threading.Event()
            two.on_commit(lambda change: heard.set() if change.agent == "nao-1" else None)
            one.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-1")
            two.update("INSERT DATA { <urn:a> <urn:p> 2 }", "nao-2")
            one.update("INSERT DATA { <urn:a> <urn:p> 3 }", "nao-1")
            assert heard.wait(60.0)
            assert one.seq == 3
            assert len(two.match("urn:a")) == 3

            failed: list[Exception] = []

            def add(kb: KnowledgeBase, agent: str) -> None:
                for number in range(8):
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
            assert len(one.match("urn:b")) == 16
            assert len(one.match(None, "urn:r")) == 16 * 300
            numbers = one.select(
                f"SELECT ?n {{ ?a a <{_RT}WriteActivity> ; <{_RT}commitNumber> ?n }}"
            )
            assert sorted(int(str(r.value("n"))) for r in numbers) == list(range(1, 20))


def test_of_commits_at_the_same_moment_one_is_stored(kb: KnowledgeBase) -> None:
    """Also on servers whose updates do not see each other, as Oxigraph's and Virtuoso's."""
    store = remote_store(kb)
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
    remote_store(kb).endpoints.update(f"INSERT DATA {{ {claim} }}")
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    assert kb.seq == 1
    assert not remote_store(kb).endpoints.ask(f"ASK {{ {claim} }}")
    left = f"ASK {{ GRAPH {name} {{ ?s <urn:rtask:store:claim> ?c }} }}"
    assert not remote_store(kb).endpoints.ask(left)


def test_programs_that_end_soon_together_wait_long_enough_for_a_left_claim(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoints = remote_store(kb).endpoints
    theirs = f'GRAPH {_CLAIMS} {{ {_CLAIMS} <urn:rtask:store:claim> "somebody:1:3" }}'  # for 3 s
    endpoints.update(f"INSERT DATA {{ {theirs} }}")
    monkeypatch.setattr(endpoints.connection, "timeout_s", 1.5)
    for _ in range(20):  # each is a program of its own, and none of them waits for 3 s
        claim = Claim(endpoints, _CLAIMS)
        with contextlib.suppress(RemoteUnavailableError):
            claim.take("?s ?p ?h FILTER(false)", lambda _: None, 20)
            break
    else:
        pytest.fail("the claim was never removed")
    claim.release()
    left = "?s ?p ?o FILTER(?p IN (<urn:rtask:store:claim>, <urn:rtask:store:waited>))"
    assert not endpoints.ask(f"ASK {{ GRAPH {_CLAIMS} {{ {left} }} }}")


@pytest.mark.parametrize(
    ("noted", "is_removed"),
    [
        ("STR(NOW())", False),
        ("'2001-01-01T00:00:00Z'", True),
        ("'2090-01-01T00:00:00Z'", True),
        ("'4000000000'", True),
        ("'something else'", False),
    ],
)
def test_what_large_commits_left_is_removed_by_the_clock_of_the_server(
    kb: KnowledgeBase, noted: str, is_removed: bool
) -> None:
    endpoints = remote_store(kb).endpoints
    stage = "<urn:lab/graph/staged/of-somebody/0>"
    note = f"GRAPH {_CLAIMS} {{ {stage} <urn:rtask:store:staged> ?when }}"
    endpoints.update(f"INSERT {{ {note} }} WHERE {{ BIND({noted} AS ?when) }}")
    endpoints.update(f"INSERT DATA {{ GRAPH {stage} {{ <urn:a> <urn:p> 1 }} }}")
    remove_left_behind(endpoints, _CLAIMS)
    assert endpoints.ask(f"ASK {{ GRAPH {stage} {{ ?s ?p ?o }} }}") is not is_removed
    assert endpoints.ask(f"ASK {{ {note} }}") is not is_removed


def test_a_large_commit_whose_parts_were_removed_meanwhile_stores_nothing(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = remote_store(kb)
    graph = HeadGraph(store.endpoints, store.dialect)
    take = Claim.take

    def remove_first(*args: Any, **more: Any) -> None:
        take(*args, **more)
        monkeypatch.setattr(head, "_age_s", lambda noted, now: 7_200.0)
        remove_left_behind(store.endpoints, _CLAIMS)

    monkeypatch.setattr(Claim, "take", remove_first)
    old, size = store.read_head(), store.dialect.abilities.statements
    quads = [Quad(iri("urn:a"), iri("urn:p"), literal(n), iri("urn:g")) for n in range(size + 1)]
    with pytest.raises(CallFailedError, match="nothing was stored; try again"):
        graph.replace(old, Head(old.seq + 1, "ours"), Writes({}, dict.fromkeys(quads)), None)
    assert store.read_head() == old
    assert store.count(iri("urn:g")) == 0


class _Watched(Endpoints):
    """Does something before or after certain updates, as another process might."""

    def __init__(self, endpoints: Endpoints, meddle: Callable[[Endpoints, int], None]) -> None:
        super().__init__(
            endpoints.query_url, endpoints.update_url, endpoints.connection, endpoints.address
        )
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

    endpoints = _Watched(remote_store(kb).endpoints, remove)
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

    remote_store(kb).endpoints.update(f"INSERT DATA {{ {theirs} }}")
    endpoints = _Watched(remote_store(kb).endpoints, withdraw)
    claim = Claim(endpoints, _CLAIMS)
    claim.take("?s ?p ?h FILTER(false)", lambda _: None, 20)
    claim.release()
    assert len(set(endpoints.claimed)) == len(endpoints.claimed) == 3


def test_a_process_does_not_overtake_its_own_commit_that_got_no_answer(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoints = remote_store(kb).endpoints
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


class _Lossy(Endpoints):
    """Loses the first commit, on its way to the server or on the way back."""

    def __init__(self, endpoints: Endpoints, arrives: bool, meanwhile: str = "") -> None:
        super().__init__(
            endpoints.query_url, endpoints.update_url, endpoints.connection, endpoints.address
        )
        self._arrives = arrives
        self._meanwhile = meanwhile
        self.commits = 0

    def update(self, text: str) -> None:
        if not text.startswith("DELETE {"):
            super().update(text)
            return
        self.commits += 1
        if self.commits > 1 or self._arrives:
            super().update(text)
        if self.commits == 1:
            if self._meanwhile:
                super().update(self._meanwhile)
            raise RemoteUnavailableError("the connection broke off")


@pytest.mark.parametrize("arrives", [False, True])
def test_a_commit_without_an_answer_is_stored_once(kb: KnowledgeBase, arrives: bool) -> None:
    store = remote_store(kb)
    endpoints = _Lossy(store.endpoints, arrives)
    old = store.read_head()
    quad = Quad(iri("urn:s"), iri("urn:p"), literal(1), iri("urn:g"))
    writes = Writes({}, {quad: None})
    HeadGraph(endpoints, store.dialect).replace(old, old.next("ours"), writes, None)
    assert endpoints.commits == 2 - arrives
    assert store.read_head() == old.next("ours")
    assert store.count(iri("urn:g")) == 1


def test_a_commit_that_was_lost_while_another_was_stored_is_refused(kb: KnowledgeBase) -> None:
    store = remote_store(kb)
    graph, old = HeadGraph(store.endpoints, store.dialect), store.read_head()
    theirs = (
        f"DELETE WHERE {{ {graph.pattern(str(old))} }} ; "
        f"INSERT DATA {{ {graph.pattern(str(old.next('theirs')))} }}"
    )
    endpoints = _Lossy(store.endpoints, arrives=False, meanwhile=theirs)
    quad = Quad(iri("urn:s"), iri("urn:p"), literal(1), iri("urn:g"))
    with pytest.raises(VersionConflictError, match="somebody else committed"):
        HeadGraph(endpoints, store.dialect).replace(
            old, old.next("ours"), Writes({}, {quad: None}), None
        )
    assert store.read_head() == old.next("theirs")
    assert store.count(iri("urn:g")) == 0


def test_commits_of_others_are_taken_in_after_a_request_for_them_failed(
    place: Callable[..., KnowledgeBase], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with place(reason=True) as one:
        remote_store(one)
        one.load(TBOX, format="turtle", graph="urn:lab/graph/import/tbox")
        with place(again=True, reason=True, folder=tmp_path / "other") as two:
            two.update("INSERT DATA { <urn:m0> a <urn:t:Mug> }", "nao-2")
            sync = remote_store(two).on_moved.__self__  # type: ignore[attr-defined]

            def fail(_: int = 0) -> Any:
                raise RemoteUnavailableError("away")

            with monkeypatch.context() as patch:
                patch.setattr(sync._journal, "records", fail)
                one.update("INSERT DATA { <urn:m1> a <urn:t:Mug> }", "nao-1")
                with contextlib.suppress(RemoteUnavailableError):
                    sync.look()
            sync.look()
            thing = (rtask.rdf.terms.RDF_TYPE, iri("urn:t:Thing"))
            assert two.explain("urn:m1", *thing).holds


def test_what_a_server_cannot_do_is_said_plainly(kb: KnowledgeBase, tmp_path: Path) -> None:
    remote_store(kb)
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with pytest.raises(UnsupportedError):
        kb.backup(tmp_path / "backup")
    with pytest.raises((UnsupportedError, UsageError)):
        kb.as_of(0)
    if not remote_store(kb).dialect.abilities.triple_terms:
        with pytest.raises(UnsupportedError, match="triple terms"), kb.transaction() as tx:
            tx.add("urn:a", "urn:p", 2, confidence=0.5)
    assert kb.seq == 1


@pytest.mark.parametrize("kind", KINDS[2:])
def test_a_server_killed_under_load_loses_nothing_and_keeps_nothing_half(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport, "_PAUSE_S", 0.01)
    server = MAKERS[kind](tmp_path / "server")
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
        with opened(server.address, **options) as kb:
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
        with opened(server.address, **options) as kb:
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
