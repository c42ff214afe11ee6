"""Plans by the operations of the engine: with whose rights, within which bounds, stored once."""

from __future__ import annotations

import pytest

import rtask
from rtask.engine import Engine
from rtask.errors import (
    BusyError,
    ConflictError,
    ForbiddenError,
    QuerySyntaxError,
    SearchLimit,
    UnknownTermError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.tasks.bounds import Bounds
from tests.rtask.tasks.conftest import BASE, CUP, LAB, NAO, TABLE

pytestmark = pytest.mark.slow

ANN, ROBOT = Access("ann", "teacher"), Access("nao-1", "robot")
GOAL = "every cup into the left box"
WITH_TEXT = "?x rt:locatedOn ?y WHERE { %s }"


@pytest.fixture
def engine():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        yield engine


def test_a_plan_is_stored_as_it_was_agreed_to_and_not_after_the_graph_has_changed(engine):
    plan = engine.call("plan_goal", {"goal": GOAL}, ANN)
    assert (plan.complete, len(plan.steps), plan.domain) == (True, 4, "")
    stored = engine.call("store_plan", {"goal": GOAL, "digest": plan.digest}, ANN)
    graph = engine.kb.graphs.agent("ann")
    assert list(engine.kb.match(rtask.rdf.terms.iri(stored.task), RT.goalText, graph=graph))
    engine.kb.update(
        f"{PREFIXES} INSERT DATA {{ <{BASE}robot/panda-1> rt:reaches <{BASE}place/left> }}"
    )
    with pytest.raises(ConflictError, match="plan again"):
        engine.call("store_plan", {"goal": GOAL, "digest": plan.digest}, ANN)
    assert len(engine.call("store_plan", {"goal": GOAL}, ANN).steps) == 2


def test_a_robot_plans_for_itself_alone(engine):
    with pytest.raises(ForbiddenError, match="plans for itself alone, and the plan needs panda-1"):
        engine.call("store_plan", {"goal": GOAL}, ROBOT)
    own = engine.call("store_plan", {"goal": "give the pen to nao-1"}, ROBOT)
    assert [step.robots for step in own.steps] == [[NAO]]
    with pytest.raises(ForbiddenError):
        engine.call("store_plan", {"goal": GOAL}, Access("eve", "reader"))


def test_a_caller_limited_to_some_graphs_plans_from_these_alone(engine):
    limited = Access("guest", "reader", frozenset({f"read:{BASE}graph/agent/guest"}))
    goal = f"<{CUP}> rt:locatedOn <{TABLE}>"
    assert engine.call("plan_goal", {"goal": goal}, ANN).complete
    with pytest.raises(UnknownTermError):
        engine.call("plan_goal", {"goal": "every cup onto the table"}, limited)
    assert not engine.call("plan_goal", {"goal": goal}, limited).complete


@pytest.mark.parametrize(
    ("where", "error"),
    [
        ("SERVICE <http://127.0.0.1:1/sparql> { ?x ?p ?y }", ForbiddenError),
        ("?x rt:locatedOn ?y } #", QuerySyntaxError),
        ("?x rt:locatedOn ?y } ; DROP ALL #", UsageError),
    ],
)
def test_the_query_of_a_goal_calls_nobody_changes_nothing_and_hides_no_bound(engine, where, error):
    before = engine.kb.seq
    with pytest.raises((error, QuerySyntaxError, UsageError)):
        engine.call("plan_goal", {"goal": WITH_TEXT % where}, ANN)
    assert engine.kb.seq == before


def test_planning_ends_in_time_and_says_that_it_is_not_known():
    times = iter([0.0, 1.0])
    with rtask.open(":memory:", base=BASE) as kb:
        bounds = Bounds(kb, 60.0, clock=lambda: next(times, 61.0))
        assert not bounds.select(f"SELECT ?s {{ ?s a {RT.Cup} }}")
        with pytest.raises(SearchLimit, match="ended after 60 s: whether there is a plan is not"):
            bounds.select(f"SELECT ?s {{ ?s a {RT.Cup} }}")


def test_plans_are_made_one_at_a_time(engine, monkeypatch):
    monkeypatch.setattr("rtask.engine.operations.tasks.plan._PATIENCE_S", 0.01)
    with engine.context.planning, pytest.raises(BusyError, match="other plans are being made"):
        engine.call("plan_goal", {"goal": GOAL}, ANN)
    assert engine.call("plan_goal", {"goal": GOAL}, ANN).complete


def test_a_goal_in_json_has_a_bounded_number_of_parts(engine):
    part = {"achieve": f"<{CUP}> rt:locatedOn <{TABLE}>"}
    with pytest.raises(UsageError, match="at most 50 goals at once, not 51"):
        engine.kb.tasks.plan({"goals": [part] * 51})
