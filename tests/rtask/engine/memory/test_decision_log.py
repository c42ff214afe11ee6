"""Decisions outlast the process, a file that is none, and being passed on."""

from __future__ import annotations

import json
import logging
import sqlite3

import numpy as np
import pytest

from grasp.spatial.candidate import Contacts
from rtask.engine.decision_log import FILE, DecisionLog
from rtask.engine.decisions import Decision, Offer
from rtask.engine.records.asked import record_of
from rtask.errors import UsageError

CUP = Offer(
    (0.01, -0.02, 0.03, 0.5), 0.0, 0.0, 0.8, (1.5, 0.25), (0.0, 0.0, 0.6, 0.8),
    Contacts("suction", np.array([[0.0, 0.0, 0.001]]), np.array([[0.0, 0.0, -1.0]]), 0.015),
)  # fmt: skip
JAWS = Offer((0.1, 0.2, 0.3, 1.5), 0.03, 0.05, 0.9, (2.0, 1.0))
DECISION = Decision(
    "urn:object", None, {"candidate:0": JAWS, "urn:grasp": CUP}, {"query_s": 0.5}, 7, "nao-1",
    "urn:thing",
)  # fmt: skip


def tasks(count):
    return {f"t-{k}": Decision(f"urn:{k}", None) for k in range(count)}


def test_a_decision_is_the_same_after_a_restart(tmp_path):
    log = DecisionLog(tmp_path / FILE)
    log.put("t-1", DECISION)
    log.close()
    again = DecisionLog(tmp_path / FILE)
    read = again.get("t-1")
    again.close()
    assert read.to_json() == DECISION.to_json()
    assert (read.asked_by, read.exemplar, read.seed) == ("nao-1", "urn:thing", 7)
    assert read.offers["candidate:0"] == JAWS


def test_a_decision_passed_on_as_a_record_is_the_same():
    made = record_of(
        json.loads(json.dumps({"kind": "decision", "task": "t", **DECISION.to_json()}))
    )
    assert made.decided_for("nao-1").to_json() == DECISION.to_json()


@pytest.mark.parametrize(
    "offers",
    [
        {"candidate:0": {**JAWS.to_json(), "width": float("nan")}},
        {"candidate:0": {**JAWS.to_json(), "in_object": [0, 0, 0]}},
        {"candidate:0": {**JAWS.to_json(), "belief": "ab"}},
        {"candidate:0": {"in_object": [0, 0, 0, 0]}},
        {"candidate:0": {**CUP.to_json(), "contacts": {"kind": "jaws"}}},
        ["candidate:0"],
    ],
)
def test_a_record_with_a_broken_offer_is_refused(offers):
    with pytest.raises(UsageError, match="decision: "):
        record_of({"kind": "decision", "task": "t", "object": "", "seed": 0, "offers": offers})


def test_only_the_newest_remain_in_memory_and_in_the_file(tmp_path):
    log = DecisionLog(tmp_path / FILE, size=3)
    for task, decision in tasks(8).items():
        log.put(task, decision)
    log.put("t-6", Decision("urn:again", None))
    log.close()
    again = DecisionLog(tmp_path / FILE, size=3)
    remembered = {task: again.get(task) for task in tasks(8)}
    again.close()
    assert {task for task, decision in remembered.items() if decision} == {"t-6", "t-7"}
    assert remembered["t-6"].object == "urn:again"


def test_a_file_that_is_no_database_costs_no_decision(tmp_path, caplog):
    (tmp_path / FILE).write_text("something else" * 100)
    with caplog.at_level(logging.WARNING):
        log = DecisionLog(tmp_path / FILE)
    assert "decisions are in memory only" in caplog.text
    log.put("t-1", DECISION)
    assert log.get("t-1") is DECISION
    log.close()


def test_a_row_that_cannot_be_read_counts_as_none(tmp_path, caplog):
    log = DecisionLog(tmp_path / FILE)
    log.put("t-1", DECISION)
    log.close()
    with sqlite3.connect(tmp_path / FILE) as db:
        db.execute("UPDATE decisions SET text = '{}'")
    db.close()
    again = DecisionLog(tmp_path / FILE)
    with caplog.at_level(logging.WARNING):
        assert again.get("t-1") is None
    assert "t-1 cannot be read" in caplog.text
    again.close()
