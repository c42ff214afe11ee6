"""A robot with nothing to do takes over what another one has not begun, where that is sooner."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from xml.etree import ElementTree

import pytest

import rtask
from rtask.engine import Engine
from rtask.errors import ConflictError, ForbiddenError, UnknownTermError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, Quad
from rtask.tasks.queue import claiming
from rtask.tasks.queue.reading import QueuedPlan, read_queue
from tests.rtask.tasks.conftest import BASE, LEFT, NAO, PANDA, TABLE
from tests.rtask.tasks.queue.idle_lab import GOAL, OTHER, idle_lab, reach_of, thing

pytestmark = pytest.mark.slow

ANN = Access("ann", "teacher")
AS = {iri: Access(iri.rpartition("/")[2], "robot") for iri in (NAO, OTHER, PANDA)}


@pytest.fixture
def engine() -> Iterator[Engine]:
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(idle_lab())
        yield engine


def store(engine: Engine, goal: str = GOAL, access: Access = ANN) -> str:
    """Store a plan that gives all to the Panda; then the Naos reach what it reaches."""
    task = engine.call("store_plan", {"goal": goal}, access).task
    engine.kb.update(reach_of(NAO, OTHER))
    return task


def claim(engine: Engine, robot: str):
    return engine.call("claim_step", {}, AS[robot])


def do(engine: Engine, robot: str):
    """Claim a step and say that it is done."""
    step = claim(engine, robot)
    place = step.arguments["hand" if step.action == RT.Grasp.value else "place"]
    engine.call("end_step", {"task": step.task, "result": "done", "place": place}, AS[robot])
    return step


def plan_of(engine: Engine) -> QueuedPlan:
    (plan,) = read_queue(engine.kb)
    return plan


def test_an_idle_robot_takes_a_whole_pair_over_and_all_say_so(engine):
    root = store(engine)
    began = claim(engine, PANDA)
    before = {step.task: step for step in plan_of(engine).steps}
    pick = do(engine, NAO)
    assert pick.claimed
    assert (pick.arguments["robot"], pick.arguments["hand"]) == (NAO, f"{NAO}/hand")
    assert pick.arguments["thing"] != began.arguments["thing"]
    assert "nao-1 picks" in pick.text
    assert "taken over from panda-1, which had not begun it" in pick.reason
    put = claim(engine, NAO)
    assert (put.arguments["thing"], put.arguments["place"]) == (pick.arguments["thing"], LEFT)
    plan = plan_of(engine)
    taken = [step for step in plan.steps if step.robots == (NAO,)]
    assert [step.task for step in taken] == [pick.task, put.task]
    assert all(step.taken_from == (PANDA,) and step.assignment for step in taken)
    # Nothing else of the plan has changed.
    rest = {step.task: step.arguments for step in plan.steps if step not in taken}
    assert rest == {task: before[task].arguments for task in rest}
    takes_part = {quad.object.value for quad in engine.kb.match(NamedNode(root), RT.assignedTo)}
    assert takes_part == {NAO, PANDA}
    (listed,) = engine.call("list_plans", {}, ANN).plans
    said = {step.task: step for step in listed.steps}
    assert (said[put.task].robots, said[put.task].taken_from) == ([NAO], [PANDA])
    assert "had not begun it" in said[put.task].assignment
    why = engine.call("explain_failure", {"subject": put.task}, ANN)
    assert (why.ended, why.held, why.causes) == (False, False, [])
    assert "nao-1's: taken over from panda-1" in why.text


def test_the_former_robot_is_told_who_has_it_and_goes_on(engine):
    store(engine)
    claim(engine, PANDA)
    pick = claim(engine, NAO)
    told = claim(engine, PANDA).taken
    assert [one.task for one in told] == [pick.task, f"{pick.plan}/{told[1].task[-1]}"]
    assert all(one.why.startswith("nao-1 has it: taken over from panda-1") for one in told)
    with pytest.raises(ConflictError, match=r"robot/nao-1's now: taken over from panda-1"):
        engine.call("end_step", {"task": pick.task, "result": "done"}, AS[PANDA])
    done = 0
    while (step := claim(engine, PANDA)).claimed:
        assert step.arguments["thing"] != pick.arguments["thing"]
        do(engine, PANDA)
        done += 1
    assert done == 6
    assert len(step.taken) == 2
    do(engine, NAO)
    do(engine, NAO)
    assert plan_of(engine).state(dt.datetime.now(dt.UTC)) == "done"
    assert claim(engine, PANDA).taken == []


def test_several_take_over_and_each_thing_is_brought_once(engine):
    store(engine)
    did = []
    claim(engine, PANDA)
    while any(claim(engine, robot).claimed for robot in (NAO, OTHER)):
        did += [
            (robot, do(engine, robot)) for robot in (NAO, OTHER) if claim(engine, robot).claimed
        ]
    assert {robot for robot, _ in did} == {NAO, OTHER}
    assert len({step.task for _, step in did}) == len(did) == 6
    do(engine, PANDA)
    do(engine, PANDA)
    assert not claim(engine, PANDA).claimed
    assert plan_of(engine).state(dt.datetime.now(dt.UTC)) == "done"


def test_what_a_robot_has_begun_or_asked_about_stays_its_own(engine):
    store(engine)
    kb, now = engine.kb, dt.datetime.now(dt.UTC)
    begun = claiming.claim_step(kb, PANDA, AS[PANDA], lease_s=1.0, now=now).step
    later = now + dt.timedelta(hours=1)
    for _ in range(3):
        assert do(engine, NAO).arguments["thing"] != begun.thing
        do(engine, NAO)
    rest = claiming.claim_step(kb, NAO, AS[NAO], now=later).step
    assert rest is None, "it may be in the hand of a robot whose program ended"
    again = claiming.claim_step(kb, PANDA, AS[PANDA], now=later).step
    assert again.task == begun.task


def test_nothing_is_taken_where_the_goal_says_who_the_plan_does_not_say_or_a_robot_planned(engine):
    for goal in ("panda-1 should put every cup into the left box", f"{GOAL}, not by nao-1"):
        named = store(engine, goal)
        assert not claim(engine, NAO).claimed
        engine.call("cancel_plan", {"plan": named, "reason": "next"}, ANN)
        engine.kb.update(
            f"{PREFIXES} DELETE WHERE {{ GRAPH ?g {{ <{NAO}> rt:reaches ?x }} }} ; "
            f"DELETE WHERE {{ GRAPH ?g {{ <{OTHER}> rt:reaches ?x }} }}"
        )
    own = store(engine, "panda-1 should put every cup into the left box", AS[PANDA])
    told = f"<{own}> rt:allowsTakeover"
    graph = f"{BASE}graph/agent/panda-1"
    engine.kb.update(
        f"{PREFIXES} DELETE DATA {{ GRAPH <{graph}> {{ {told} false }} }} ; "
        f"INSERT DATA {{ GRAPH <{graph}> {{ {told} true }} }}"
    )
    assert plan_of_robot(engine, own).allows_takeover
    assert not claim(engine, NAO).claimed
    engine.call("cancel_plan", {"plan": own, "reason": "next"}, ANN)
    old = engine.call("store_plan", {"goal": f"<{thing(0)}> rt:locatedOn <{LEFT}>"}, ANN)
    graph = f"{BASE}graph/agent/ann"
    engine.kb.update(f"{PREFIXES} DELETE WHERE {{ GRAPH <{graph}> {{ ?p rt:allowsTakeover ?o }} }}")
    idle = OTHER if old.steps[0].robots == [NAO] else NAO
    assert not claim(engine, idle).claimed, "an older version did not say what may be dropped"


def test_a_robot_cannot_say_of_the_plan_of_another_that_it_may_be_taken_over_or_out_of_order():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(idle_lab(1, 1))
        task = store(engine, "panda-1 should put every cup into the left box")
        kb.update(f"{PREFIXES} INSERT DATA {{ <{task}> rt:allowsTakeover true }}", access=AS[NAO])
        assert not claim(engine, NAO).claimed
        engine.call("cancel_plan", {"plan": task, "reason": "next"}, ANN)
        kb.update(f"{PREFIXES} DELETE DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}> rt:reaches "
                  f"<{TABLE}> . <{OTHER}> rt:reaches <{TABLE}> }} }}")  # fmt: skip
        task = store(engine, "every cup into the left box, then every pen into the left box")
        did = do(engine, PANDA)
        said = " ".join(
            f"<{task}> rt:hasSubTask <{task}/{n}> . <{task}/{n}> rt:waitsForHand <{task}/2> ."
            for n in (3, 4)
        )
        kb.update(f"{PREFIXES} INSERT DATA {{ {said} }}", access=AS[NAO])
        assert did.arguments["thing"] == thing(0)
        assert not claim(engine, NAO).claimed, "the pen comes after the cup"


def plan_of_robot(engine: Engine, task: str) -> QueuedPlan:
    return next(plan for plan in read_queue(engine.kb) if plan.task == task)


@pytest.mark.parametrize(
    "lack",
    [
        f"DELETE DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}> rt:reaches <{LEFT}> }} }}",
        f"DELETE DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}> rt:reaches <{TABLE}> }} }}",
        f"INSERT DATA {{ <{NAO}/hand> a rt:OutOfOrder }}",
        f"INSERT DATA {{ <{LEFT}> rt:beyondReachOf <{NAO}/hand> }}",
        f"INSERT DATA {{ <{LEFT}> a rt:Shut }}",
        f"DELETE DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}/hand> rt:maxOpening 0.05e0 }} }} ; "
        f"INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}/hand> rt:maxOpening 0.03e0 }} }}",
        f"DELETE DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}/hand> rt:maxPayload 0.2e0 }} }} ; "
        f"INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ <{NAO}/hand> rt:maxPayload 0.05e0 }} }}",
    ],
    ids=["box", "table", "hand", "side", "door", "opening", "payload"],
)  # fmt: skip
def test_only_what_a_robot_is_proved_to_be_able_to_do_is_taken(engine, lack):
    store(engine)
    engine.kb.update(f"{PREFIXES} {lack}")
    assert not claim(engine, NAO).claimed
    assert {step.robots for step in plan_of(engine).steps} == {(PANDA,)}


def test_a_robot_with_something_in_its_hand_takes_nothing_over(engine):
    store(engine)
    engine.call("state_place", {"thing": thing(3), "place": f"{NAO}/hand"}, AS[NAO])
    assert not claim(engine, NAO).claimed


def test_nothing_is_taken_for_less_than_the_margin(engine):
    store(engine, f"<{thing(0)}> rt:locatedOn <{LEFT}>")
    kb, plan = engine.kb, plan_of(engine)

    def at(seconds: float):
        return claiming.claim_step(kb, NAO, AS[NAO], now=plan.made + dt.timedelta(seconds=seconds))

    assert at(3.9).step is None, "its robot may begin any moment, and would be as fast"
    assert at(4.5).step is not None, "it is late by a quarter of the time that it takes"


def test_the_order_of_a_goal_holds_whoever_does_it():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(idle_lab(2, 2))
        store(engine, "every cup into the left box, then every pen into the left box")
        cups = {thing(0), thing(1)}
        (plan,) = read_queue(kb)
        pens = [step for step in plan.steps if step.thing not in cups]
        puts = {s.task for s in plan.steps if s.thing in cups and s.action == RT.Place.value}
        assert all(puts <= set(step.after) - set(step.for_hand) for step in pens)
        did = [do(engine, NAO) for _ in range(2)]
        first = claim(engine, PANDA)
        assert {first.arguments["thing"], did[0].arguments["thing"]} == cups
        assert not claim(engine, NAO).claimed, "a cup is not in the box yet"
        do(engine, PANDA)
        do(engine, PANDA)
        assert claim(engine, NAO).arguments["thing"] not in cups


def test_what_the_order_of_a_goal_asks_for_is_no_wait_for_a_hand_after_a_takeover():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(idle_lab(3, 2, heavy=(0, 1, 2)))
        kb.update(reach_of(NAO))
        store(engine, "every cup into the left box, then every pen into the right box")
        cups = {thing(0), thing(1), thing(2)}
        own = {step.task for step in plan_of(engine).steps if step.robots == (NAO,)}
        assert own, "while cups are too heavy for it, the Nao has pens"
        light = "DELETE { GRAPH ?g { ?x rt:mass 1.0e0 } } INSERT { GRAPH ?g { ?x rt:mass 0.1e0 } }"
        kb.update(f"{PREFIXES} {light} WHERE {{ GRAPH ?g {{ ?x rt:mass 1.0e0 }} }}")
        claim(engine, PANDA)
        assert claim(engine, NAO).arguments["thing"] in cups, "it need not wait for its pens"
        puts = {s.task for s in plan_of(engine).steps if s.thing in cups}
        pens = [step for step in plan_of(engine).steps if step.task in own]
        assert all(puts & set(step.after) and not puts & set(step.for_hand) for step in pens)


def test_what_came_before_a_pair_in_the_hand_of_its_robot_still_does():
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(idle_lab(3, heavy=(0, 2)))
        store(engine)
        first, second, third = (plan_of(engine).steps[n : n + 2] for n in (0, 2, 4))
        assert second[0].thing == thing(1)
        assert second[1].task in third[0].for_hand
        claim(engine, PANDA)
        assert claim(engine, NAO).task == second[0].task
        last = next(s for s in plan_of(engine).steps if s.task == third[0].task)
        assert first[1].task in last.for_hand
        assert not {step.task for step in second} & set(last.after), "another hand is in no way"


def test_the_tree_of_a_stored_plan_is_that_of_the_present_assignment(engine):
    """Its one sequence can be done as it stands: no hand takes a second thing."""
    engine.kb.update(reach_of(NAO))
    engine.call("store_plan", {"goal": GOAL}, ANN)
    engine.kb.update(reach_of(OTHER))
    first = claim(engine, NAO)
    while any(claim(engine, robot).claimed and do(engine, robot) for robot in (NAO, OTHER)):
        pass
    plans = engine.call("list_plans", {"state": "all", "behaviour_tree": True}, ANN).plans
    (tree,) = (ElementTree.fromstring(p.behaviour_tree) for p in plans if p.task == first.plan)
    actions = tree.findall(".//Sequence/*")
    assert {node.get("robot") for node in actions} == {
        robot for step in plan_of_robot(engine, first.plan).steps for robot in step.robots
    }
    held: dict[str, str] = {}
    for node in actions:
        hand, item = node.get("hand"), node.get("thing")
        if node.tag == "Grasp":
            assert hand not in held
            held[hand] = item
        else:
            assert held.pop(hand) == item


def test_nobody_changes_a_plan_but_by_a_claim_and_no_more_of_it_than_that(engine):
    task = store(engine)
    step = f"{task}/3"
    graph = f"{BASE}graph/agent/ann"
    with pytest.raises(ForbiddenError, match="may not write"):
        engine.kb.update(
            f"{PREFIXES} INSERT DATA {{ GRAPH <{graph}> {{ <{step}> rt:assignedTo <{NAO}> }} }}",
            access=AS[NAO],
        )
    mine = Quad(NamedNode(step), RT.assignedTo, NamedNode(NAO), NamedNode(graph))

    def more_than_permitted():
        with engine.kb.transaction(access=AS[NAO]) as tx:
            tx.replace_permitted([], [mine])
            tx.add(step, RT.stepNumber, 99, graph)

    with pytest.raises(ForbiddenError, match="may not write"):
        more_than_permitted()
    assert not engine.kb.match(NamedNode(step), RT.assignedTo, NamedNode(NAO))
    for stranger, error in (
        (Access("stranger", "robot"), UnknownTermError), (ANN, ForbiddenError),
        (Access("eve", "reader"), ForbiddenError),
    ):  # fmt: skip
        with pytest.raises(error):
            engine.call("claim_step", {"robot": "nao-1"} if stranger.role != "robot" else {},
                        stranger)  # fmt: skip
    # What a robot says of itself in its own graph makes it no owner of the step.
    engine.kb.update(f"{PREFIXES} INSERT DATA {{ <{step}> rt:assignedTo <{NAO}> }}", access=AS[NAO])
    assert step not in {claim(engine, OTHER).task, claim(engine, NAO).task}


def test_two_robots_that_find_the_same_get_different_things(engine, monkeypatch):
    """Both have looked before either has it: the one that comes second looks again."""
    store(engine)
    kb, now, found = engine.kb, dt.datetime.now(dt.UTC), []
    find = claiming.find_takeover

    def late(*arguments):
        offer = find(*arguments)
        found.append(offer.pick.task)
        if len(found) == 1:
            won.append(claiming.claim_step(kb, OTHER, AS[OTHER], now=now).step)
        return offer

    won = []
    monkeypatch.setattr(claiming, "find_takeover", late)
    second = claiming.claim_step(kb, NAO, AS[NAO], now=now).step
    assert found[0] == found[1] == won[0].task, "both were after the same"
    assert second.thing != won[0].thing
    assert {step.thing: step.robots for step in plan_of(engine).steps if step.taken_from} == {
        won[0].thing: (OTHER,), second.thing: (NAO,)
    }  # fmt: skip
