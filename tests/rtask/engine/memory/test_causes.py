"""Hidden causes are facts of the graph that are always those of the outcomes that count."""

from __future__ import annotations

import datetime as dt
from collections import Counter

import pytest

import ontology
import rtask
from rtask.asking.questions import answer
from rtask.engine.memory.causes import restate
from rtask.engine.memory.experience import Weights, without_trials
from rtask.engine.memory.hidden import tries_from_above
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.policy import Policy
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import iri, literal

pytestmark = pytest.mark.slow

ANN = Access("ann", "teacher")


def at(x, **more):
    return {"in_object": {"x": x, "y": 0.0, "z": 0.01, "theta": 1.57}, "quality": 0.6,
            "opening": 0.04, **more}  # fmt: skip


def report(robot, thing, x, held=False, reason="slip_lift", number=1, **more):
    outcome = {"success": held, "reason": "ok" if held else reason, "preset": "faithful",
               "attempt_number": number}  # fmt: skip
    return robot.call(
        "report_outcome", object=thing, gripper_id=robot.gripper, grasp=at(x), outcome=outcome,
        **more,
    )  # fmt: skip


def curate(engine, **said):
    return engine.call("curate_object", said, ANN).as_json()


def facts(engine):
    """Return the statements of the graph of causes."""
    return {tuple(quad)[:3] for quad in engine.kb.match(graph=engine.kb.graphs.causes)}


def causes(engine, thing):
    """Return the stored causes of an object by class, with probabilities."""
    rows = engine.kb.select(f"""PREFIX rt: <{ontology.NS}>
SELECT ?kind ?p ?from ?to ?centre WHERE {{ <{thing}> rt:hasHiddenCause ?cause .
  ?cause a ?kind ; rt:causeProbability ?p FILTER(?kind IN (rt:GraspZone, rt:MassOffCentre))
  OPTIONAL {{ ?cause rt:zoneStart ?from ; rt:zoneEnd ?to }}
  OPTIONAL {{ ?cause rt:centreAlongX ?centre }} }} ORDER BY DESC(?p)""")
    return [row.to_dict() for row in rows]


def fresh(engine, thing):
    """Whether the stored causes are those that the stored attempts imply."""
    return restate(engine.context, engine.kb.match, iri(thing)) == ([], [])


@pytest.fixture
def kb():
    """Return a store with a reasoner, so that the shapes hold and verdicts count."""
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


@pytest.fixture
def pen(bench, robots):
    """Two robots, and a pen that the first has inserted."""
    one, two = robots("nao-1"), robots("nao-2")
    return one, two, one.insert(bench.sight(bench.PEN), name="pen")["objects"][0]["object"]


def test_failures_of_two_robots_say_together_what_hides(engine, pen):
    one, two, thing = pen
    report(one, thing, 0.0)
    assert not facts(engine)
    report(two, thing, 0.033)
    found = causes(engine, thing)
    assert {row["kind"] for row in found} == {RT.GraspZone.value, RT.MassOffCentre.value}
    (mass,) = [row for row in found if row["centre"] is not None]
    (zone,) = [row for row in found if row["from"] is not None]
    assert float(mass["centre"]) < 0 < float(zone["to"])
    (cause, *_) = engine.kb.match(iri(thing), RT.hasHiddenCause)
    derived = {q.object for q in engine.kb.match(cause.object, PROV.wasDerivedFrom)}
    assert derived == {q.subject for q in engine.kb.match(None, RT.executesGrasp)}
    assert not engine.kb.validate()


def test_what_is_lost_on_the_way_fails_a_grasp_but_tells_nothing_of_what_hides(engine, pen):
    one, two, thing = pen
    for number, (robot, x) in enumerate(((one, 0.0), (two, 0.033), (two, 0.033))):
        report(robot, thing, x, reason="slip_transport", number=max(number, 1))
    assert not facts(engine)
    report(two, thing, 0.033, number=3)
    hand = next(h for h in engine.context.grippers.all() if h.robot.value.endswith("nao-2"))
    robot = hand.robot.value
    memory = recall(engine.kb, Question(objects=(thing,), tracked=thing, robot=robot))
    tallies = [tally for grasp in memory.grasps for tally in grasp.tallies]
    assert all(not tally.held for tally in tallies)
    assert Counter(t.lost for t in tallies for _ in range(t.count)) == {True: 3, False: 1}
    others = [grasp for grasp in without_trials(memory) if grasp.tallies]
    assert [(t.lost, t.count) for grasp in others for t in grasp.tallies] == [(True, 1)]
    now = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
    weights = Weights(Policy(), {thing: 1.0}, hand.gripper, (0.14, 0.02, 0.02), now)
    tried = tries_from_above(memory, others, weights)
    assert tried is not None
    assert (tried.places * tried.length).round(3).tolist() == [0.033]
    assert fresh(engine, thing)


def test_the_order_of_the_outcomes_makes_no_difference(bench, engine, robots):
    robot = robots("nao-1")
    tries = [(0.0, False), (0.033, False), (-0.033, True), (-0.02, True)]
    found = []
    for order, seed in ((tries, 3), (tries[::-1], 4)):
        thing = robot.insert(bench.sight(bench.Thing(bench.PEN.size, texture_seed=seed)))
        name = thing["objects"][0]["object"]
        for x, held in order:
            report(robot, name, x, held)
        found.append(causes(engine, name))
    # Cameras measure both pens with a noise of half a millimetre.
    for a, b in zip(*found, strict=True):
        assert a["kind"] == b["kind"]
        assert float(a["p"]) == pytest.approx(float(b["p"]), abs=0.05)


@pytest.mark.parametrize(
    ("reason", "kind"),
    [("crushed", "zone_fragile"), ("came_apart", "zone_comes_off"), ("slip_hold", "zone_slippery"),
     ("missed", None)],
)  # fmt: skip
def test_reasons_tell_in_which_way_a_part_gives_way(engine, pen, reason, kind):
    robot, _, thing = pen
    for x in (0.0, 0.033):
        report(robot, thing, x, reason=reason)
    report(robot, thing, -0.033, held=True)
    kinds = [quad.object.value for quad in engine.kb.match(None, RT.zoneKind)]
    assert kinds == ([] if kind is None else [getattr(RT, kind).value])
    told = {quad.object.value for quad in engine.kb.match(None, RT.explainsReason)}
    assert told == {getattr(RT, f"reason_{reason}").value}


def test_a_withdrawn_robot_takes_its_share_of_the_causes_along(engine, pen):
    one, two, thing = pen
    for x, held in ((0.0, False), (0.033, False)):
        report(one, thing, x, held)
    alone = facts(engine)
    report(two, thing, 0.02, held=True)
    report(two, thing, -0.033)
    assert facts(engine) != alone
    done = engine.call("withdraw_contributor", {"contributor": "nao-2"}, ANN).as_json()
    assert facts(engine) == alone
    curate(engine, operation="undo", commit=done["commit"])
    assert facts(engine) != alone
    assert fresh(engine, thing)
    engine.call("withdraw_contributor", {"contributor": "nao-1"}, ANN)
    assert fresh(engine, thing)
    engine.call("withdraw_contributor", {"contributor": "nao-2"}, ANN)
    assert not facts(engine)


def test_an_object_that_nobody_else_uses_goes_with_its_causes(engine, pen):
    one, _, thing = pen
    for x in (0.0, 0.033):
        report(one, thing, x)
    done = engine.call("withdraw_contributor", {"contributor": "nao-1"}, ANN).as_json()
    assert (done["objects"], done["kept"]) == (1, 0)
    assert not facts(engine)
    assert not engine.kb.match(iri(thing))


def test_verdicts_of_people_change_the_causes(engine, pen):
    robot, _, thing = pen
    for k, x in enumerate((0.0, 0.033)):
        report(robot, thing, x, task_id=f"urn:try:{k}")
    before = facts(engine)
    judge = {"task_id": "urn:try:1", "verdict": "refuse"}
    engine.call("give_feedback", judge, ANN)
    assert facts(engine) != before
    assert fresh(engine, thing)
    engine.call("give_feedback", {**judge, "verdict": "confirm"}, ANN)
    assert facts(engine) == before


def test_merging_and_forgetting_leave_no_stale_cause(bench, engine, pen):
    one, two, thing = pen
    other = two.insert(bench.sight(bench.Thing(bench.PEN.size, texture_seed=9)))
    twin = other["objects"][0]["object"]
    for x in (0.0, 0.033):
        report(one, thing, x)
        report(two, twin, x)
    report(two, twin, -0.033, held=True)
    curate(engine, operation="merge", object=twin, into=thing)
    assert fresh(engine, thing)
    assert not engine.kb.match(iri(twin), RT.hasHiddenCause)
    (zone,) = engine.kb.match(None, RT.zoneKind)
    derived = engine.kb.match(zone.subject, PROV.wasDerivedFrom)
    assert len(derived) == 5
    curate(engine, operation="forget", object=thing)
    assert not facts(engine)


def test_rebuilding_restores_damaged_causes(engine, pen):
    robot, _, thing = pen
    for x in (0.0, 0.033):
        report(robot, thing, x)
    before = facts(engine)
    with engine.kb.transaction() as tx:
        tx.clear(engine.kb.graphs.causes)
    assert not facts(engine)
    engine.rebuild_statistics()
    assert facts(engine) == before


def test_robots_cannot_state_causes_themselves(engine, pen):
    with (
        pytest.raises(ForbiddenError, match="graph/causes"),
        engine.kb.transaction(access=Access("nao-1", "robot")) as tx,
    ):
        tx.add("urn:mug", RT.hasHiddenCause, iri("urn:cause"), engine.kb.graphs.causes)


def test_a_query_says_why_an_object_slips(engine, pen):
    one, two, thing = pen
    report(one, thing, 0.0)
    report(two, thing, 0.033)
    report(two, thing, -0.033, held=True)
    query = next(path for path in ontology.episode_queries() if path.stem == "eq21")
    rows = [row.to_dict() for row in engine.kb.select(query.read_text())]
    assert {(row["object"], row["robots"], row["reasons"], row["attempts"]) for row in rows} <= {
        ("pen", robots, "slip_lift", 3) for robots in ("nao-1 nao-2", "nao-2 nao-1")
    }
    assert "slippery" in {str(row["what"]) for row in rows}


def test_the_latest_attempts_speak_however_many_there_are(engine, pen, monkeypatch):
    monkeypatch.setattr("rtask.engine.memory.causes.MAX_TRIED", 3)
    _, two, thing = pen
    for k, x in enumerate((0.0, 0.01, 0.033, 0.02, 0.03)):
        report(two, thing, x, task_id=f"urn:try:{k}")
    attempts = sorted({q.subject for q in engine.kb.match(None, RT.executesGrasp)}, key=str)

    def speaking():
        links = engine.kb.match(None, PROV.wasDerivedFrom, graph=engine.kb.graphs.causes)
        return sorted({q.object for q in links}, key=str)

    assert len(attempts) == 5
    assert speaking() == attempts[-3:]
    assert fresh(engine, thing)
    for who, verdict in ((ANN, "confirm"), (Access("bob", "teacher"), "refuse")):
        engine.call("give_feedback", {"task_id": "urn:try:4", "verdict": verdict}, who)
    assert speaking() == attempts[-4:-1]  # two people disagree: the last one counts no more
    assert fresh(engine, thing)


def test_why_it_failed_is_answered_with_the_believed_cause_and_its_chance(engine, pen):
    one, two, thing = pen
    report(one, thing, 0.0)
    assert "believed" not in answer(engine.kb, "why did it fail?").sentence
    report(two, thing, 0.033, reason="crushed")
    report(two, thing, -0.033, held=True)
    (zone,) = [row for row in causes(engine, thing) if row["from"] is not None]
    found = answer(engine.kb, "why did it fail?")
    chance = f"{100 * float(zone['p']):.0f} %"
    assert found.sentence.lower().startswith("crushed: 1 (believed: pen ")
    words = next(p for p in found.sentence.split("pen ") if p.startswith("is fragile from "))
    assert f"chance {chance}" in words
    explained = {quad.object for quad in engine.kb.match(None, RT.explainsFailure)}
    held = {q.subject for o in engine.kb.match(None, RT.success, literal(True))
            for q in engine.kb.match(None, RT.hasOutcome, o.subject)}  # fmt: skip
    assert len(explained) == 2
    assert not explained & held


def test_an_answer_names_the_cause_that_decided(bench, engine, pen):
    one, two, thing = pen
    report(one, thing, 0.033)
    report(one, thing, 0.0)
    report(one, thing, -0.033, held=True)
    grasps = two.recognise(bench.sight(bench.PEN), object=thing, max_grasps=50)["grasps"]
    by_place = {grasp["in_object"]["x"]: grasp["explanation"] for grasp in grasps}
    weak, sound = by_place[max(by_place)], by_place[min(by_place)]
    assert weak["cause"]["end"] > 0.03
    assert weak["cause"]["probability"] > 0.3
    assert "because it gives way from " in weak["text"]
    assert f"with a chance of {weak['cause']['probability']:.2f}" in weak["text"]
    assert "cause" not in sound
