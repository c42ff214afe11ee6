"""A robot asks people about a step if that is worth its price, and does others meanwhile."""

from __future__ import annotations

import datetime as dt
import json

import cv2
import numpy as np
import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.errors import ConflictError, ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, PROV, RT
from rtask.rdf.terms import iri
from rtask.tasks.questions.price import Prices
from rtask.tasks.questions.question import Choice
from rtask.tasks.queue import asking, claiming
from rtask.tasks.storing import Order
from tests.rtask.tasks.conftest import BASE, LAB, NAO, PANDA, PEN, RIGHT

pytestmark = pytest.mark.slow

ANN, BOB = Access("ann", "teacher"), Access("bob", "teacher")
AS_NAO, AS_PANDA = Access("nao-1", "robot"), Access("panda-1", "robot")
GOAL = "every cup into the left box"
CHOICES = [
    {"code": "go_on", "text": "Try it"},
    {"code": "helped", "text": "I have helped", "helps": True},
]
NOW = dt.datetime(2026, 1, 2, tzinfo=dt.UTC)


@pytest.fixture
def engine():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        yield engine


def store(engine, goal=GOAL, asking=5, failing=60, **more):
    prices = {"asking_price": asking, "failing_price": failing}
    return engine.call("store_plan", {"goal": goal, **prices, **more}, ANN).task


def claim(engine, access=AS_PANDA):
    return engine.call("claim_step", {}, access)


def ask(engine, task, access=AS_PANDA, **more):
    fields = {"task": task, "kind": "act", "text": "What shall I do?", "choices": CHOICES}
    return engine.call("ask_person", {**fields, **more}, access)


def answer(engine, question, choice=2, access=ANN, **more):
    return engine.call("answer_question", {"question": question, "choice": choice, **more}, access)


def listed(engine, state="all"):
    return engine.call("list_questions", {"state": state}, AS_NAO).questions


def test_a_question_is_asked_only_where_it_is_expected_to_save_more_than_it_costs(engine):
    store(engine, asking=5, failing=60)
    step = claim(engine)
    assert (step.asks, step.asked, step.answer) == (True, [], None)
    sure = ask(engine, step.task, chance=0.9)
    assert (sure.asked, sure.gain) == (False, pytest.approx(0.5 * 0.1 * 60))
    assert claim(engine).task == step.task, "the robot keeps the step that it did not ask about"
    doubtful = ask(engine, step.task, chance=0.8)
    assert doubtful.asked
    assert doubtful.reason.startswith("asking costs 5 and is expected to save 6: 0.20 failures")


def test_without_prices_nobody_is_asked(engine):
    engine.call("store_plan", {"goal": GOAL}, ANN)
    step = claim(engine)
    assert not step.asks
    assert not ask(engine, step.task, chance=0.0).asked
    with pytest.raises(UsageError, match="failing_price is missing"):
        engine.call("store_plan", {"goal": GOAL, "asking_price": 3}, ANN)


def test_the_step_waits_for_the_answer_and_the_robot_does_another_meanwhile(engine):
    cup = store(engine)
    store(engine, "the pen into the right box")
    step = claim(engine)
    asked = ask(engine, step.task, chance=0.1)
    other = claim(engine)
    assert (other.claimed, other.arguments["thing"]) == (True, PEN)
    assert other.waiting[0].why == "a person is asked: What shall I do?"
    assert not other.waiting[0].stuck
    (plan, _) = engine.call("list_plans", {}, ANN).plans
    assert (plan.task, plan.state, plan.steps[0].state) == (cup, "running", "asked")
    assert plan.steps[0].question == asked.question
    engine.call("end_step", {"task": other.task, "result": "released"}, AS_PANDA)
    answer(engine, asked.question, remark="it was wet")
    again = claim(engine)
    assert again.task == step.task
    assert (again.answer.code, again.answer.by, again.answer.remark) == (
        "helped", "ann", "it was wet",
    )  # fmt: skip
    assert again.asked == ["act"]
    with pytest.raises(ConflictError, match="act was asked about"):
        ask(engine, step.task, chance=0.0)


def test_what_nobody_answers_in_time_is_done_as_it_would_have_been(engine):
    kb = engine.kb
    kb.tasks.store(kb.tasks.plan(GOAL), order=Order(prices=Prices(0.0, 60.0)))
    step = claiming.claim_step(kb, PANDA, AS_PANDA, now=NOW).step
    choices = (Choice("go_on", "Try it"), Choice("helped", "I have helped", helps=True))
    inquiry = asking.Inquiry("act", "Shall I?", choices, patience_s=60.0)
    asked = asking.ask(kb, PANDA, step.task, inquiry, AS_PANDA, now=NOW)
    soon, later = NOW + dt.timedelta(seconds=59), NOW + dt.timedelta(seconds=61)
    assert claiming.claim_step(kb, PANDA, AS_PANDA, now=soon).step is None
    after = claiming.claim_step(kb, PANDA, AS_PANDA, now=later)
    assert after.step.task == step.task
    (question,) = after.step.questions
    assert (question.state(later), question.outcome.code) == ("expired", "go_on")
    person = f"{BASE}person/ann"
    with pytest.raises(ConflictError, match="nobody answered in time"):
        asking.answer(kb, asked.question, 2, person, ANN, now=later)
    assert asking.answer(kb, asked.question, 2, person, ANN, now=soon) is not None


def test_answers_that_help_make_asking_worth_more_and_silence_less(engine):
    gains = []
    for number in range(4):
        store(engine, "the pen into the right box", asking=0)
        step = claim(engine)
        asked = ask(engine, step.task, chance=0.0)
        gains.append(asked.gain)
        answer(engine, asked.question, 2 if number < 2 else 1)
        step = claim(engine)
        engine.call("end_step", {"task": step.task, "result": "failed"}, AS_PANDA)
    assert gains == pytest.approx([60 * 1 / 2, 60 * 2 / 3, 60 * 3 / 4, 60 * 3 / 5])


def test_the_first_answer_counts_and_only_people_answer(engine):
    store(engine)
    asked = ask(engine, claim(engine).task, chance=0.0)
    with pytest.raises(ForbiddenError):
        answer(engine, asked.question, access=AS_NAO)
    with pytest.raises(UsageError, match="choice: 1 to 2, not 3"):
        answer(engine, asked.question, 3)
    with pytest.raises(UnknownTermError, match="no robot asked"):
        answer(engine, RIGHT)
    assert answer(engine, asked.question).commit
    assert answer(engine, asked.question).commit == ""
    with pytest.raises(ConflictError, match="ann answered before: I have helped"):
        answer(engine, asked.question, access=BOB)
    with pytest.raises(ForbiddenError, match="cannot act for 'panda-1'"):
        ask(engine, claim(engine).task, AS_NAO, robot="panda-1")


def test_an_answer_that_a_robot_wrote_itself_answers_nobody(engine):
    store(engine)
    asked = ask(engine, claim(engine).task, chance=0.0)
    engine.kb.update(
        f"""{PREFIXES} INSERT DATA {{ <urn:a> a rt:HumanAnswer ;
        rt:answersQuestion <{asked.question}> ; rt:chosenAnswer <{asked.question}/choice/2> ;
        prov:wasAttributedTo <{BASE}person/ann> ;
        prov:generatedAtTime "2026-01-01T10:00:00Z"^^xsd:dateTime }}""",
        "nao-1",
    )
    assert [one.state for one in listed(engine)] == ["open"]


def test_a_question_whose_plan_was_cancelled_is_withdrawn(engine):
    plan = store(engine)
    asked = ask(engine, claim(engine).task, chance=0.0)
    engine.call("cancel_plan", {"plan": plan, "reason": "enough"}, ANN)
    assert [one.state for one in listed(engine)] == ["withdrawn"]
    assert listed(engine, "open") == []
    with pytest.raises(ConflictError, match="its plan has ended"):
        answer(engine, asked.question)


def test_the_picture_is_kept_as_a_blob_and_one_that_is_none_is_refused(engine):
    store(engine)
    step = claim(engine)
    with pytest.raises(UsageError, match="picture"):
        ask(engine, step.task, chance=0.0, picture=b"no picture")
    data = bytes(cv2.imencode(".png", np.zeros((4, 6, 3), np.uint8))[1])
    asked = ask(engine, step.task, chance=0.0, picture=data)
    (question,) = listed(engine)
    assert engine.kb.blobs.read(f"urn:sha256:{question.picture}") == data
    (shown,) = engine.kb.match(iri(asked.question), RT.questionPicture)
    assert engine.kb.match(shown.object, PROV.wasAttributedTo, iri(PANDA))


def test_the_knowledge_base_lists_and_answers_questions_itself(engine):
    store(engine)
    asked = ask(engine, claim(engine).task, chance=0.0)
    (question,) = engine.kb.tasks.questions()
    assert (question.iri, question.robot, question.text) == (
        asked.question, PANDA, "What shall I do?",
    )  # fmt: skip
    engine.kb.tasks.answer(question.iri, 2, "ann")
    assert engine.kb.tasks.questions() == []
    (question,) = engine.kb.tasks.questions(everything=True)
    assert (question.answer.by, question.helped) == ("ann", True)


def test_a_person_lists_and_answers_by_commands(tmp_path, capsys):
    folder = tmp_path / "kb"

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, "-d", str(folder)])
        return ended.value.code or 0, capsys.readouterr().out

    with rtask.open(folder, base=BASE) as kb:
        kb.update(LAB)
    assert run("questions", "list")[0] == 1
    prices = ("--asking-price", "5", "--failing-price", "60")
    assert run("plan", *GOAL.split(), "--store", *prices)[0] == 0
    assert run("plan", *GOAL.split(), "--store", "--asking-price", "5")[0] == 2
    with rtask.open(folder) as kb, Engine(kb) as engine:
        asked = ask(engine, claim(engine).task, chance=0.1)
    code, out = run("questions", "list")
    assert code == 0
    assert "panda-1: What shall I do?  (open for" in out
    assert "    1. Try it  (if nobody answers)\n    2. I have helped\n" in out
    code, out = run("questions", "answer", asked.question, "2", "--agent", "ann")
    assert (code, out.splitlines()[0]) == (0, "the robot takes up its step again")
    assert "2. I have helped  <- ann" in run("questions", "list", "--all")[1]
    (question,) = json.loads(run("questions", "list", "--all", "--json")[1])
    assert (question["state"], question["chosen"]) == ("answered", 2)


def test_a_robot_may_not_order_by_a_question_about_the_step_of_another(engine):
    store(engine)
    step = claim(engine)
    with pytest.raises(ConflictError, match="has not claimed"):
        ask(engine, step.task, AS_NAO, chance=0.0)
    assert listed(engine) == []
    assert NAO not in {one.robot for one in listed(engine)}
