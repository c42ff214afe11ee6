"""Records at a follower while its writer is away, and how the writer takes them."""

from __future__ import annotations

import json
from collections import Counter

import httpx
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.follow.asked_records import plan_asked_records, store_waiting
from endpoint.follow.record_spool import FILE, RecordSpool
from endpoint.http.messages import Request
from rtask.engine import Engine
from rtask.kb.commit.access import Access

NAO = Access("nao-1", "robot")


def decision(number):
    return {"kind": "decision", "task": f"t-{number}", "object": "", "seed": number}


def test_records_wait_on_disk_for_the_writer_across_a_restart_and_arrive_in_order(tmp_path):
    def away(records):
        raise httpx.ConnectError("nobody there")

    file = tmp_path / "asked.db"
    spool = RecordSpool(file, away)
    spool.start()
    for number in range(3):
        spool.put(decision(number), NAO)
    assert not spool.wait_until_sent(10.0), "nobody waits for a writer that is away"
    spool.close()
    arrived = []

    def here(records):
        arrived.extend(one["record"]["task"] for one in records)
        return []

    spool = RecordSpool(file, here)
    assert spool.waiting == 3
    spool.start()
    assert spool.wait_until_sent(30.0)
    spool.close()
    assert arrived == ["t-0", "t-1", "t-2"]


@pytest.mark.parametrize("limits", [{"max_records": 2}, {"max_bytes": 300}])
def test_the_oldest_are_dropped_and_counted_where_there_are_too_many(tmp_path, limits):
    lost = Counter()
    sent = []
    spool = RecordSpool(
        tmp_path / "asked.db",
        lambda records: sent.extend(records) or [],
        lambda reason, count: lost.update({reason: count}),
        **limits,
    )
    for number in range(10):
        spool.put(decision(number), NAO)
    assert spool.waiting == 2
    assert lost == {"full": 8}
    spool.start()
    assert spool.wait_until_sent(30.0)
    spool.close()
    assert [one["record"]["task"] for one in sent] == ["t-8", "t-9"]


@pytest.fixture(scope="module")
def engine():
    with rtask.open(":memory:", reason=False) as kb, Engine(kb) as made:
        yield made


def post(engine, tokens, records):
    body = json.dumps({"records": records}).encode()
    headers = {"content-type": "application/json"}
    request = Request("POST", "/replicate/asked", "", headers, body, "", "")
    return json.loads(plan_asked_records(engine, tokens, request).run().body)


def entry(number, agent="nao-1", role="robot"):
    return {"id": str(number), "agent": agent, "role": role, "record": decision(number)}


def test_a_writer_takes_records_and_names_those_that_it_refuses(engine):
    tokens = TokenStore(None)
    _, token = tokens.create("robot", agent="nao-9")
    tokens.revoke(token.id)
    bad = {**entry(3), "record": {"kind": "triples"}}
    reader = entry(4, None, "reader")
    answer = post(engine, tokens, [entry(1), entry(2, "nao-9"), bad, reader])
    assert answer["stored"] == 1
    assert [one["id"] for one in answer["refused"]] == ["2", "3", "4"]
    assert engine.context.decisions.get("t-1").seed == 1
    assert engine.context.decisions.get("t-2") is None, "its robot's token was revoked"


def test_what_waits_in_the_folder_of_a_promoted_follower_is_stored_once(tmp_path):
    def away(records):
        raise httpx.ConnectError("nobody there")

    tokens = TokenStore(None)
    _, token = tokens.create("robot", agent="nao-9")
    tokens.revoke(token.id)
    with rtask.open(tmp_path / "copy", reason=False, ontologies=False) as kb, Engine(kb) as made:
        store_waiting(made, tokens)
        assert not (kb.folder / FILE).exists(), "a server that never followed has no such file"
        spool = RecordSpool(kb.folder / FILE, away)
        spool.put(decision(7), NAO)
        spool.put(decision(8), Access("nao-9", "robot"))
        spool.close()
        store_waiting(made, tokens)
        assert made.context.decisions.get("t-7").seed == 7
        assert made.context.decisions.get("t-8") is None, "its robot's token was revoked"
        spool = RecordSpool(kb.folder / FILE, away)
        assert spool.waiting == 0
        spool.close()
