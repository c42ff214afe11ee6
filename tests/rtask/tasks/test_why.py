"""Why something failed, and the smallest change under which it would have held."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.errors import UnknownTermError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.diagnosis import diagnose
from rtask.tasks.diagnosis.attempt import Failure, Hand, Try
from rtask.tasks.diagnosis.hypotheses import report_chance
from tests.rtask.tasks.conftest import BASE, LAB, TABLE

pytestmark = pytest.mark.slow

ANN, NAO, PANDA = Access("ann", "teacher"), Access("nao-1", "robot"), Access("panda-1", "robot")
PEN = f"{BASE}object/3"
MEASURES = f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
  <{PEN}> rt:extentX 0.2e0 . <{BASE}object/2> rt:extentX 0.2e0 }} }}"""


@pytest.fixture
def engine():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        kb.update(MEASURES)
        yield engine


def tried(engine, who, along, reason="ok", product=PEN):
    """Report an attempt; return its IRI."""
    name = f"try-{who.agent}-{along}-{product[-1]}"
    engine.call(
        "report_outcome",
        {
            "task_id": name,
            "object": product,
            "grasp": {"id": "", "in_object": {"x": along, "y": 0.0, "z": 0.0, "theta": 0.0}},
            "outcome": {"success": reason == "ok", "reason": reason, "placed": True},
        },
        who,
    )
    (row,) = engine.kb.select(
        f'{PREFIXES} SELECT ?a WHERE {{ ?a rt:requestId "{name}" ; rt:hasOutcome ?o }}'
    )
    return str(row.value("a"))


def test_a_centre_of_mass_is_told_from_a_slippery_thing_by_where_it_held(engine):
    for along in (0.04, 0.07):
        tried(engine, PANDA, along)
        tried(engine, NAO, along + 0.01)
    for along in (-0.09, -0.07):
        tried(engine, PANDA, along, "slip_lift")
    attempt = tried(engine, NAO, -0.08, "slip_hold")
    answer = engine.call("explain_failure", {"subject": attempt}, ANN)
    assert answer.causes[0].kind in ("centre_of_mass", "weak_zone"), answer.text
    assert (answer.mends, answer.change.kind) == (True, "grasp")
    assert 0.02 < answer.change.along < 0.1, answer.text


def test_an_object_is_asked_about_by_its_name(engine):
    tried(engine, NAO, -0.08, "slip_hold")
    (row,) = engine.kb.select(f"{PREFIXES} SELECT ?n WHERE {{ <{PEN}> rt:name ?n }}")
    by_name = engine.call("explain_failure", {"subject": str(row.value("n"))}, ANN)
    assert by_name.reason == "slip_hold"
    assert by_name.text == engine.call("explain_failure", {"subject": PEN}, ANN).text
    for wrong in ("no such pen", "x y", ">} ."):
        with pytest.raises(UnknownTermError, match="no object in the graph has this name"):
            engine.call("explain_failure", {"subject": wrong}, ANN)


def test_a_weak_end_closes_under_the_hand_which_reports_that_it_missed(engine):
    failed = tried(engine, NAO, -0.04, "missed")
    tried(engine, NAO, 0.0, "missed")
    for who in (NAO, PANDA):
        tried(engine, who, 0.08)
    answer = engine.call("explain_failure", {"subject": failed}, ANN)
    assert answer.causes[0].kind == "weak_zone", answer.text
    assert "held in 1 of 1 attempts" in answer.change.text, answer.text  # of hands of its kind


def test_attempts_that_are_not_taken_into_account_are_announced(engine, monkeypatch):
    for along in (0.04, 0.07, 0.05):
        tried(engine, PANDA, along)
    attempt = tried(engine, NAO, -0.08, "slip_hold")
    whole = engine.call("explain_failure", {"subject": attempt}, ANN)
    assert "other attempts alone" not in whole.text
    monkeypatch.setattr("rtask.tasks.diagnosis.reading._MAX_OTHERS", 2)
    cut = engine.call("explain_failure", {"subject": attempt}, ANN)
    assert re.search(r"judged by the latest \d other attempts alone", cut.text)


def test_a_slippery_thing_fails_wherever_it_is_held(engine):
    for along in (-0.06, 0.0, 0.06):
        tried(engine, NAO, along, "slip_lift")
        tried(engine, NAO, along, product=f"{BASE}object/1")
    attempt = tried(engine, NAO, 0.03, "slip_lift")
    answer = engine.call("explain_failure", {"subject": attempt}, ANN)
    assert answer.causes[0].kind == "slippery", answer.text
    assert any("0 of 3" in clue for clue in answer.causes[0].evidence)


@pytest.mark.parametrize(
    ("where", "is_nowhere"), [({"lost": True}, True), ({"place": TABLE}, False)]
)
def test_a_thing_that_is_lost_after_a_failure_was_seen_nowhere(engine, where, is_nowhere):
    engine.call("store_plan", {"goal": "every pen into the left box"}, ANN)
    step = engine.call("claim_step", {}, NAO)
    engine.call(
        "end_step", {"task": step.task, "result": "failed", "comment": "missed", **where}, NAO
    )
    answer = engine.call("explain_failure", {"subject": step.task}, ANN)
    assert ("afterwards it was seen elsewhere, or nowhere" in answer.text) == is_nowhere


def test_a_hand_that_fails_at_everything_is_replaced_by_another(engine):
    for along in (-0.05, 0.0, 0.05):
        tried(engine, NAO, along, "slip_lift", f"{BASE}object/1")
        tried(engine, PANDA, along)
    attempt = tried(engine, NAO, 0.0, "slip_lift")
    answer = engine.call("explain_failure", {"subject": attempt}, ANN)
    assert answer.causes[0].kind == "weak_hand", answer.text
    assert sum(cause.chance for cause in answer.causes) <= 1.0001
    assert answer.change.robot.endswith("panda-1")


def failure(reason, *others):
    own = Try(Hand("hand", "robot"), "product", "thing", along=0.05, reason=reason)
    past = tuple(
        replace(own, held=held, reason="", along=along, is_other=True) for along, held in others
    )
    return Failure("task", "task", "", "it picks a pen up", own, length=0.2, others=past)


@pytest.mark.parametrize("reason", ["touched", "pushed_away"])
def test_what_nothing_known_explains_has_another_cause_and_no_claim_of_a_change(reason):
    answer = diagnose(
        failure(reason, *((along, True) for along in (-0.07, -0.03, 0.0, 0.05, 0.08)))
    )
    assert answer.causes[0].kind == "unknown", answer.text
    assert not answer.mends
    assert "another cause, which is none of those that are known here" in answer.text
    assert "no change that is known would have mended it" in answer.text
    assert "it would have held" not in answer.text


def test_the_chance_of_another_cause_is_part_of_an_answer_that_is_sure_of_a_known_one():
    answer = diagnose(failure("hardware", (0.0, True)))
    assert (answer.causes[0].kind, answer.mends) == ("hardware", False)  # there is no other hand
    (left,) = [cause.chance for cause in answer.causes if cause.kind == "unknown"]
    assert 0.0 < left < 0.1


def test_a_change_that_is_not_told_apart_from_failing_again_is_not_offered():
    answer = diagnose(failure("hardware"))
    assert answer.change.chance - answer.again < 0.1
    assert answer.text.endswith("no change that is known would have mended it")


@pytest.mark.parametrize(
    ("reason", "known", "mends"),
    [
        ("hardware", {}, "hand"),
        ("tracking", {}, ""),
        ("timed_out", {"is_late": True}, "earlier"),
        ("timed_out", {}, ""),
        ("missed", {"age_s": 7200.0, "is_elsewhere": True}, "look"),
        ("missed", {"age_s": 7200.0}, ""),
    ],
)
def test_a_change_is_said_to_mend_only_where_something_speaks_for_its_cause(reason, known, mends):
    others = [(along, True) for along in (-0.07, -0.03, 0.0, 0.05, 0.08)]
    asked = replace(failure(reason, *others), hands=(Hand("other", "another robot"),), **known)
    answer = diagnose(asked)
    assert (answer.change.kind if answer.mends else "") == mends, answer.text


def test_a_caller_is_told_only_what_it_may_read(engine):
    attempt = tried(engine, NAO, 0.0, "slip_lift")
    guest = Access("guest", "reader", frozenset({f"read:{BASE}graph/agent/guest"}))
    with pytest.raises(UnknownTermError):
        engine.call("explain_failure", {"subject": attempt}, guest)


def run(*arguments):
    with pytest.raises(SystemExit) as caught:
        main(list(arguments))
    assert caught.value.code == 0


def test_what_held_has_no_cause_and_what_was_never_tried_is_unknown(engine):
    attempt = tried(engine, NAO, 0.0)
    answer = engine.call("explain_failure", {"subject": attempt}, ANN)
    assert (answer.held, answer.causes, answer.change) == (True, [], None)
    with pytest.raises(UnknownTermError, match="'a name' is no IRI"):
        engine.call("explain_failure", {"subject": "a name"}, ANN)
    with pytest.raises(UnknownTermError, match="no attempt"):
        engine.call("explain_failure", {"subject": TABLE}, ANN)


@pytest.mark.parametrize(
    ("result", "comment", "kind", "change"),
    [
        ("failed", "it is not seen at the table", "stale_place", "look"),
        ("declined", "a person said no", "declined", "ask"),
    ],
)
def test_a_step_that_ended_without_an_attempt_has_a_cause(engine, result, comment, kind, change):
    plan = engine.call("store_plan", {"goal": "every pen into the left box"}, ANN).task
    step = engine.call("claim_step", {}, NAO)
    lost = {"lost": True} if result == "failed" else {}
    end = {"task": step.task, "result": result, "comment": comment, **lost}
    engine.call("end_step", end, NAO)
    for subject in (plan, step.task):
        answer = engine.call("explain_failure", {"subject": subject}, ANN)
        assert (answer.causes[0].kind, answer.change.kind) == (kind, change), answer.text
        assert (answer.step, answer.attempt) == (step.task, "")


def test_a_step_that_is_carried_out_or_was_given_back_has_not_failed(engine):
    plan = engine.call("store_plan", {"goal": "every pen into the left box"}, ANN).task
    step = engine.call("claim_step", {}, NAO).task
    for result in ("", "released"):
        if result:
            engine.call("end_step", {"task": step, "result": result}, NAO)
        with pytest.raises(UnknownTermError, match="no step that ended"):
            engine.call("explain_failure", {"subject": plan}, ANN)
        why = engine.call("explain_failure", {"subject": step}, ANN)
        assert (why.ended, why.held, why.mends, why.causes, why.change) == (
            False, False, False, [], None
        )  # fmt: skip
        assert "the plan gives step 1" in why.assignment


def test_the_command_prints_the_cause_and_the_change(tmp_path, capsys):
    with rtask.open(tmp_path / "kb", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        attempt = tried(engine, NAO, 0.0, "hardware")
        assert kb.tasks.why(attempt).mends
    run("why", attempt, "-d", str(tmp_path / "kb"))
    assert "out of order" in capsys.readouterr().out
    run("why", attempt, "-d", str(tmp_path / "kb"), "--json")
    assert json.loads(capsys.readouterr().out)["causes"][0]["kind"] == "hardware"


def test_reports_of_each_cause_are_chances():
    codes = ["slip_lift", "missed", "hardware", "ik"]
    assert all(0 < report_chance("chance", code) < 1 for code in codes)
    # Whoever does not know the cause must not know its report: none is likelier than a tenth.
    assert max(report_chance("unknown", code) for code in (*codes, "touched", "crushed")) <= 0.1
    assert report_chance("out_of_reach", "ik") > 10 * report_chance("slippery", "ik")
