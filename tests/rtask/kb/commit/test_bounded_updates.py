"""Updates within limits: evaluated in a reader, ended there, committed exactly."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator

import psutil
import pytest

import rtask
from rtask.errors import (
    BusyError,
    DataError,
    ForbiddenError,
    QuerySyntaxError,
    QueryTimeout,
    QueryTooExpensive,
)
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.update_answering import MAX_UNDONE
from rtask.knowledge_base import KnowledgeBase

LIMITS = UpdateLimits(30.0)
GROW = "INSERT { <urn:s> <urn:p> ?z } WHERE { <urn:s> <urn:p> ?x BIND(CONCAT(?x, ?x) AS ?z) }"


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", ontologies=False, reason=False) as opened:
        opened.update("INSERT DATA { <urn:s> <urn:p> 'xxxxxxxxxx' . <urn:t> <urn:q> 1 }")
        yield opened


def test_a_literal_that_doubles_in_each_operation_is_refused_and_stores_nothing(
    kb: KnowledgeBase,
) -> None:
    before, seq = sorted(map(str, kb.match())), kb.seq
    with pytest.raises(QueryTooExpensive, match="1048576 characters in one literal"):
        kb.update(" ;\n".join([GROW] * 40), limits=LIMITS)
    assert (sorted(map(str, kb.match())), kb.seq) == (before, seq)


@pytest.mark.slow
def test_a_literal_that_doubles_within_one_where_ends_its_reader_not_this_process(
    kb: KnowledgeBase,
) -> None:
    steps = " ".join(f"BIND(CONCAT(?x{i}, ?x{i}) AS ?x{i + 1})" for i in range(36))
    text = f"INSERT {{ <urn:s> <urn:q> ?x36 }} WHERE {{ <urn:s> <urn:p> ?x0 {steps} }}"
    own = psutil.Process()
    before = own.memory_info().rss
    with pytest.raises(QueryTooExpensive, match="memory"):
        kb.update(text, limits=UpdateLimits(60.0, memory_bytes=128 << 20))
    with pytest.raises(QueryTooExpensive, match="refused for ten minutes"):
        kb.update(text, limits=LIMITS)
    # the literal would have 640 GB; what this process keeps is far below one doubling of it
    assert own.memory_info().rss - before < 64 << 20
    assert kb.update("INSERT DATA { <urn:still> <urn:works> true }", limits=LIMITS).added == 1


@pytest.mark.slow
def test_a_product_behind_harmless_data_ends_at_its_deadline(kb: KnowledgeBase) -> None:
    data = " . ".join(f"<urn:a{i}> <urn:b> {i}" for i in range(300))
    endless = "?a <urn:b> ?b . ?c <urn:b> ?d . ?e <urn:b> ?f . ?g <urn:b> ?h"
    text = (
        f"INSERT DATA {{ {data} }} ; "
        f"INSERT {{ <urn:n> <urn:is> ?n }} WHERE {{ SELECT (COUNT(*) AS ?n) {{ {endless} }} }}"
    )
    with pytest.raises(QueryTimeout, match=re.escape("did not end within 0.5 s")):
        kb.update(text, limits=UpdateLimits(0.5))
    assert not kb.query("ASK { <urn:a1> ?p ?o }")


def test_too_many_statements_solutions_or_bytes_are_refused_by_name(kb: KnowledgeBase) -> None:
    rows = " ".join(map(str, range(2_000)))
    text = f"INSERT {{ ?s <urn:n> ?i }} WHERE {{ ?s <urn:p> ?o VALUES ?i {{ {rows} }} }}"
    for limits, name in (
        (UpdateLimits(30.0, statements=1_999), "statements"),
        (UpdateLimits(30.0, delta_bytes=10_000), "bytes of statements"),
        (UpdateLimits(30.0, solutions=1_999), "solutions of one WHERE"),
    ):
        with pytest.raises(QueryTooExpensive, match=name):
            kb.update(text, limits=limits)
    assert kb.update(text, limits=UpdateLimits(30.0, statements=2_000)).added == 2_000


def test_a_literal_beyond_the_limit_that_is_stored_may_be_copied_and_removed(
    kb: KnowledgeBase,
) -> None:
    limits = UpdateLimits(30.0, literal_bytes=5)
    copied = kb.update(f"COPY {kb.graphs.shared} TO <urn:copy>", limits=limits)
    assert copied.added == 2
    assert kb.update("DELETE WHERE { GRAPH <urn:copy> { ?s ?p ?o } }", limits=limits).removed == 2


def test_a_reader_that_evaluated_an_update_answers_as_if_it_had_not(kb: KnowledgeBase) -> None:
    small = "INSERT { GRAPH <urn:fresh> { ?s <urn:seen> true } } WHERE { ?s <urn:p>|<urn:q> ?o }"
    with pytest.raises(ForbiddenError):
        kb.update(small, agent="nao-1", limits=LIMITS)
    with pytest.raises(DataError):
        kb.update(f"{small} ; MOVE <urn:missing> TO <urn:other>", limits=LIMITS)
    assert not kb.query("ASK { ?s <urn:seen> true }")
    assert not kb.query("ASK { GRAPH <urn:fresh> {} }")
    kb.update(small, limits=LIMITS)
    # the reader made and undid the change itself before it received the commit
    counted = kb.query("SELECT (COUNT(*) AS ?n) { GRAPH <urn:fresh> { ?s <urn:seen> true } }")
    assert counted[0].value("n") == 2


@pytest.mark.slow
def test_a_change_too_large_to_be_undone_ends_its_reader_and_is_stored(kb: KnowledgeBase) -> None:
    rows = " ".join(map(str, range(MAX_UNDONE)))
    text = f"INSERT {{ ?s <urn:n> ?i }} WHERE {{ ?s <urn:p>|<urn:q> ?o VALUES ?i {{ {rows} }} }}"
    assert kb.update(text, limits=LIMITS).added == 2 * MAX_UNDONE
    again = f"DELETE {{ ?s <urn:n> ?i }} WHERE {{ ?s <urn:n> ?i }} ; {text}"
    assert kb.update(again, limits=LIMITS).removed == 0  # removed and added again: no change
    assert kb.query("SELECT (COUNT(*) AS ?n) { ?s <urn:n> ?i }")[0].value("n") == 2 * MAX_UNDONE


def test_new_blank_nodes_of_two_readers_differ(kb: KnowledgeBase) -> None:
    text = (
        "INSERT { ?s <urn:blank> ?b . ?s <urn:made> _:new . ?s <urn:id> ?u } "
        "WHERE { ?s <urn:q> 1 BIND(BNODE() AS ?b) BIND(UUID() AS ?u) }"
    )
    readers = [kb.readers, None]
    for _ in readers:
        kb.update(text, limits=LIMITS)
        kb.readers.invalidate()  # the next update gets another keeper and another reader
    found = kb.query("SELECT ?o { <urn:t> <urn:blank>|<urn:made>|<urn:id> ?o }")
    assert len({str(row["o"]) for row in found}) == 6


def test_updates_that_run_at_once_are_serialised(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:counter> <urn:value> 0 }")
    text = (
        "DELETE { ?c <urn:value> ?n } INSERT { ?c <urn:value> ?m } "
        "WHERE { ?c <urn:value> ?n BIND(?n + 1 AS ?m) }"
    )
    failed: list[BaseException] = []

    def count() -> None:
        for _ in range(5):
            try:
                kb.update(text, limits=UpdateLimits(60.0))
            except BusyError:
                failed.append(AssertionError("an update lost every time for a minute"))
            except BaseException as error:  # noqa: BLE001 - shown below
                failed.append(error)

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert kb.query("SELECT ?n { <urn:counter> <urn:value> ?n }")[0].value("n") == 20


def test_errors_are_those_of_an_update_without_limits(kb: KnowledgeBase) -> None:
    other = f"GRAPH {kb.graphs.agent('nao-2')}"
    for text, kind in (
        ("INSERT { ?s <urn:p> 1 } WHERE { ?s ?p }", QuerySyntaxError),
        (f"INSERT {{ {other} {{ ?s <urn:p> 1 }} }} WHERE {{ ?s ?p ?o }}", ForbiddenError),
        (f"COPY <urn:missing> TO {kb.graphs.agent('nao-1')}", DataError),
    ):
        messages = []
        for limits in (None, LIMITS):
            with pytest.raises(kind) as caught:
                kb.update(text, agent="nao-1", limits=limits)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]
