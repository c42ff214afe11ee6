"""The change that would have mended a failure, tried in physics."""

from __future__ import annotations

from dataclasses import replace

import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from rtask.tasks.diagnosis import diagnose
from rtask.tasks.diagnosis.attempt import Failure, Hand, Try
from simulate.tasks.trials.hand_alone import try_change
from tests.rtask.tasks.conftest import BASE, LAB

EVERYTHING = "SELECT ?g ?s ?p ?o WHERE { GRAPH ?g { ?s ?p ?o } }"
HAND = Hand("urn:hand", "urn:robot", "robot", "panda_hand", 0.08, 3.0, 20.0, 0.02)
AT_END = Try(HAND, "urn:product", "", "urn:grasp", "urn:table", 0.08, reason="slip_lift")
HELD = tuple(
    Try(HAND, "urn:product", "", "urn:other", "urn:table", along, held=True, is_other=True)
    for along in (-0.06, -0.05, -0.04)
)
FAILED = tuple(
    Try(HAND, "urn:product", "", f"urn:{along}", "urn:table", along, reason="slip_hold",
        is_other=True)
    for along in (0.05, 0.06, 0.07)
)  # fmt: skip
HEAVY_LEFT = Failure(
    "urn:attempt", "urn:attempt", "", "it is picked up", AT_END, length=0.2, width=0.03,
    mass=0.6, others=HELD + FAILED, hands=(HAND,),
)  # fmt: skip


def test_another_grasp_holds_where_the_one_that_failed_fails_again():
    diagnosis = diagnose(HEAVY_LEFT)
    assert diagnosis.change.kind == "grasp"
    trial = try_change(diagnosis, tries=3)
    assert (trial.tries, trial.held, trial.reproduces, trial.agrees) == (3, 3, True, True)
    assert trial.failed_held <= 1
    assert "held 3 of 3" in trial.text
    assert "nothing was stored" in trial.text


def test_what_a_hand_and_a_thing_alone_do_not_show_is_not_tried():
    late = replace(HEAVY_LEFT, tried=replace(AT_END, reason="timed_out"), is_late=True, others=())
    diagnosis = diagnose(late)
    trial = try_change(diagnosis)
    assert (trial.tries, trial.agrees) == (0, False)
    assert f"the likeliest cause ({diagnosis.causes[0].text})" in trial.text


def test_an_unknown_length_is_said_and_never_guessed():
    diagnosis = diagnose(HEAVY_LEFT)
    assert "no change is known" in try_change(replace(diagnosis, change=None)).text
    unknown = replace(diagnosis, failure=replace(diagnosis.failure, width=None))
    assert "does not say the width" in try_change(unknown).text


def test_a_trial_at_the_command_line_leaves_the_store_as_it_was(tmp_path, capsys):
    store = tmp_path / "store"
    with rtask.open(store, base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        engine.call(
            "report_outcome",
            {"task_id": "one", "object": f"{BASE}object/3",
             "grasp": {"id": "", "in_object": {"x": 0.07, "y": 0.0, "z": 0.0, "theta": 0.0}},
             "outcome": {"success": False, "reason": "slip_lift"}},
            Access("panda-1", "robot"),
        )  # fmt: skip
        (row,) = kb.select(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
            'SELECT ?a WHERE { ?a rt:requestId "one" ; rt:hasOutcome ?o }'
        )
        attempt, before = str(row.value("a")), len(kb.select(EVERYTHING))
    with pytest.raises(SystemExit) as ended:
        main(["why", attempt, "--try", "-d", str(store)])
    assert ended.value.code == 1
    assert "not tried: " in capsys.readouterr().out
    with rtask.open(store, mode="r") as kb:
        assert len(kb.select(EVERYTHING)) == before
