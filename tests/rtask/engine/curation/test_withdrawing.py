"""Withdrawing a contributor: all that followed goes too; what others build on stays."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest

import rtask
from rtask.engine import Engine
from rtask.errors import ForbiddenError, GoneError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri, moment

ANN, BOB = Access("ann", "teacher"), Access("bob", "teacher")
GRASP = {"in_object": {"x": 0.01, "y": 0.0, "z": 0.03, "theta": 1.57}, "quality": 0.6,
         "opening": 0.04}  # fmt: skip


def withdraw(engine, name, who=ANN):
    return engine.call("withdraw_contributor", {"contributor": name}, who).as_json()


def report(robot, thing, outcome, grasp=GRASP, **more):
    return robot.call(
        "report_outcome", object=thing, gripper_id=robot.gripper, grasp=grasp, outcome=outcome,
        **more,
    )  # fmt: skip


def told(engine, name):
    return list(engine.kb.match(graph=engine.kb.graphs.agent(name)))


def belief(engine, grasp):
    """Return (alpha, beta) of the beliefs about a grasp."""
    nodes = [q.object for q in engine.kb.match(iri(grasp), RT.hasEvaluation)]
    return [
        tuple(float(q.object.value) for p in (RT.beliefAlpha, RT.beliefBeta)
              for q in engine.kb.match(node, p))
        for node in nodes
    ]  # fmt: skip


def newest(engine, grasp):
    """Return (alpha, beta) of the newest belief about a grasp."""
    rows = engine.kb.select(f"""PREFIX rt: <{RT.x.value.removesuffix("x")}>
SELECT ?alpha ?beta WHERE {{ <{grasp}> rt:hasEvaluation ?belief .
  ?belief rt:beliefAlpha ?alpha ; rt:beliefBeta ?beta ;
    <http://www.w3.org/ns/prov#generatedAtTime> ?time }} ORDER BY DESC(?time) LIMIT 1""")
    return tuple(float(rows[0].value(name)) for name in ("alpha", "beta"))


@pytest.fixture
def kb():
    """Return a store whose rules tell which verdicts count."""
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


def test_beliefs_are_those_of_the_others_as_if_it_had_never_told(bench, engine, robots):
    one, two, three = (robots(f"nao-{k}") for k in (1, 2, 3))
    thing = one.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    grasp = report(one, thing, bench.held())["grasp"]
    report(two, thing, bench.missed())
    alone = newest(engine, grasp)
    for _ in range(5):
        report(three, thing, bench.missed())
    done = withdraw(engine, "nao-3")
    assert (done["attempts"], done["grasps"], done["objects"], done["kept"]) == (5, 1, 0, 0)
    assert belief(engine, grasp) == [pytest.approx(alone)]
    answer = report(two, thing, bench.held())
    assert (answer["statistics"]["attempts"], answer["statistics"]["successes"]) == (3, 2)


def test_a_robot_stays_registered_and_may_tell_again(bench, engine, robots):
    robot = robots("nao-1")
    before = set(told(engine, "nao-1"))
    thing = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    report(robot, thing, bench.held())
    done = withdraw(engine, "nao-1")
    assert (done["objects"], done["kept"]) == (1, 0)
    assert set(told(engine, "nao-1")) == before
    assert not list(engine.index.views())
    assert robot.insert(bench.sight(bench.BOX))["objects"][0]["object"] != thing


def test_an_object_that_others_have_grasped_stays_with_what_it_needs(bench, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    thing = one.insert(bench.sight(bench.BOX), name="tea")["objects"][0]["object"]
    grasp = report(one, thing, bench.missed())["grasp"]
    unused = {**GRASP, "in_object": {**GRASP["in_object"], "x": -0.01}}
    other = report(one, thing, bench.missed(), grasp=unused)["grasp"]
    report(two, thing, bench.held())
    done = withdraw(engine, "nao-1")
    assert (done["objects"], done["kept"], done["attempts"]) == (0, 1, 2)
    assert [q.object.value for q in engine.kb.match(iri(thing), RT.name)] == ["tea"]
    assert engine.kb.match(iri(thing), RT.hasGrasp, iri(grasp))
    assert not engine.kb.match(iri(other))
    assert not engine.kb.match(None, None, iri(other))
    assert two.recognise(bench.sight(bench.BOX))["object"] == thing
    assert not engine.kb.validate()


def test_after_its_pupil_and_the_teacher_have_gone_nobody_knows_the_object(bench, engine, robots):
    teacher, pupil = robots("nao-1"), robots("nao-2")
    picture = {"data": bench.png(), "phase": "held"}
    thing = teacher.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    outcome = {**bench.held(), "images": [picture, picture]}
    grasp = report(teacher, thing, outcome)["grasp"]
    report(pupil, thing, bench.missed())
    # The belief in the grasp, without the pupil, is stated in the graph of the person.
    withdraw(engine, "nao-2")
    before = set(engine.kb.match())
    done = withdraw(engine, "nao-1")
    assert (done["attempts"], done["objects"], done["kept"]) == (1, 1, 0)
    assert not engine.kb.match(iri(thing))
    assert belief(engine, grasp) == []
    engine.call("curate_object", {"operation": "undo", "commit": done["commit"]}, ANN)
    assert {q for q in before if q.subject == iri(grasp)} <= set(engine.kb.match())
    assert len(belief(engine, grasp)) == 1


def test_its_views_go_where_others_have_seen_the_object(bench, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    mine = one.insert(bench.sight(bench.BOX))["objects"][0]
    seen = bench.sight(bench.BOX, bench.Eye(position=(0.1, 0.2, 0.6)))
    theirs = two.insert(seen, object=mine["object"])["objects"][0]
    assert theirs["view"] != mine["view"]
    withdraw(engine, "nao-1")
    views = [q.object.value for q in engine.kb.match(iri(mine["object"]), RT.hasView)]
    assert views == [theirs["view"]] == [view.view_iri for view in engine.index.views()]
    (model,) = engine.kb.match(iri(mine["object"]), RT.hasModel)
    assert [q.object.value for q in engine.kb.match(model.object, RT.builtFrom)] == views


def test_verdicts_go_and_the_robots_word_counts_again(bench, engine, robots):
    robot = robots("nao-1")
    thing = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    grasp = report(robot, thing, bench.held(), task_id="t-1")["grasp"]
    first = belief(engine, grasp)
    judge = {"task_id": "t-1", "verdict": "refuse"}
    engine.call("give_feedback", judge, BOB)
    assert belief(engine, grasp) != first
    done = withdraw(engine, "bob")
    assert (done["attempts"], done["verdicts"], done["grasps"]) == (0, 1, 1)
    assert belief(engine, grasp) == first
    engine.call("give_feedback", judge, ANN)
    again = engine.call("give_feedback", {**judge, "verdict": "confirm"}, ANN).as_json()
    assert again["statistics"]["successes"] == 1


def test_votes_after_a_withdrawn_one_are_counted_without_it(bench, engine, robots):
    robot = robots("nao-1")
    thing = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    report(robot, thing, bench.held(), task_id="t-1")
    for who, verdict in ((BOB, "refuse"), (ANN, "confirm")):
        engine.call("give_feedback", {"task_id": "t-1", "verdict": verdict}, who)
    assert engine.kb.match(None, RT.disputed)
    withdraw(engine, "bob")
    assert not engine.kb.match(None, RT.disputed)
    (votes,) = engine.kb.match(None, RT.heldVotes)
    assert votes.object.value == "1"


def test_a_withdrawal_is_undone_whole(bench, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    thing = one.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    report(one, thing, bench.missed())
    report(two, thing, bench.held())
    before = set(engine.kb.match())
    done = withdraw(engine, "nao-1")
    engine.call("curate_object", {"operation": "undo", "commit": done["commit"]}, ANN)
    here = {quad for quad in before if _is_told(quad)}
    assert {quad for quad in engine.kb.match() if _is_told(quad)} == here


def _is_told(quad):
    return "/graph/agent/" in quad.graph_name.value


def test_what_was_told_since_counts_when_a_withdrawal_is_undone(bench, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    thing = one.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    grasp = report(one, thing, bench.missed())["grasp"]
    report(two, thing, bench.held())
    done = withdraw(engine, "nao-1")
    report(two, thing, bench.held())
    report(one, thing, bench.held())
    engine.call("curate_object", {"operation": "undo", "commit": done["commit"]}, ANN)
    after = report(two, thing, bench.held())
    assert (after["statistics"]["attempts"], after["statistics"]["successes"]) == (5, 4)
    counts = [
        (q.object.value, p.object.value)
        for q in engine.kb.match(None, RT.successes)
        for p in engine.kb.match(q.subject, RT.attempts)
    ]
    assert sorted(counts) == [("1", "2"), ("3", "3")]
    assert all(len(sums) == 2 for sums in belief(engine, grasp))
    assert not engine.kb.validate()


def test_robots_may_not_withdraw_anybody_and_nobody_unknown_is(engine, robots):
    robot = robots("nao-1")
    with pytest.raises(ForbiddenError):
        robot.call("withdraw_contributor", contributor="nao-1")
    with pytest.raises(UnknownTermError, match="did you mean 'nao-1'"):
        withdraw(engine, "nao-11")


def _now():
    return dt.datetime.now(dt.UTC).timestamp()


def counted(engine, grasp):
    """Return (robot, attempts, successes) of the counts of a grasp."""
    rows = engine.kb.select(f"""PREFIX rt: <{RT.x.value.removesuffix("x")}>
SELECT ?robot ?n ?held {{ ?count rt:statisticsOf <{grasp}> ; rt:attempts ?n ; rt:successes ?held ;
  <http://www.w3.org/ns/prov#wasAttributedTo> ?robot }} ORDER BY ?robot""")
    return [(str(r.value("robot"))[-5:], r.value("n"), r.value("held")) for r in rows]


def calibrated(engine):
    """Return the number of outcomes behind the maps of each hand."""
    return sorted((q.subject.value, q.object.value) for q in engine.kb.match(None, RT.outcomeCount))


_WITHOUT_THE_DAY = (4.067, 2.533)
"""Belief that two successes of one robot and a failure of another leave."""


@pytest.mark.parametrize("has_day", [True, False])
def test_a_day_is_withdrawn_as_if_it_had_not_been(bench, engine, robots, has_day):
    """What was told before and after it counts, and the whole is undone by one commit."""
    one, two = robots("nao-1"), robots("nao-2")
    thing = one.insert(bench.sight(bench.BOX), name="tea")["objects"][0]["object"]
    first, second = one.recognise(bench.sight(bench.BOX))["grasps"][:2]
    grasp = report(one, thing, bench.held(), first)["grasp"]
    report(two, thing, bench.missed(), first)
    begin = _now()
    if has_day:
        found = one.insert(bench.sight(bench.CAN), name="odd")["objects"][0]["object"]
        for _ in range(3):
            report(one, thing, bench.missed(), first)
        later = report(one, thing, bench.missed(), second)["grasp"]
        report(one, found, bench.missed())
    end = _now()
    report(one, thing, bench.held(), first)
    if has_day:
        before = {quad for quad in engine.kb.match() if _is_told(quad)}
        asked = {"contributor": "nao-1", "since": begin, "until": end}
        done = engine.call("withdraw_contributor", asked, ANN).as_json()
        assert (done["attempts"], done["objects"], done["kept"]) == (5, 1, 0)
        assert not engine.kb.match(iri(found))
        assert not engine.kb.match(iri(later))
    assert counted(engine, grasp) == [("nao-1", 2, 2), ("nao-2", 1, 0)]
    assert newest(engine, grasp) == pytest.approx(_WITHOUT_THE_DAY)
    assert [number for _, number in calibrated(engine)] == ["2", "1"]
    assert [q.object.value for q in engine.kb.match(iri(thing), RT.name)] == ["tea"]
    assert not engine.kb.validate()
    if has_day:
        engine.call("curate_object", {"operation": "undo", "commit": done["commit"]}, ANN)
        assert {quad for quad in engine.kb.match() if _is_told(quad)} == before


def test_what_the_day_had_replaced_comes_back_and_what_others_need_stays(bench, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    thing = one.insert(bench.sight(bench.BOX), name="tea")["objects"][0]["object"]
    begin = _now()
    found = one.insert(bench.sight(bench.CAN), name="jar")["objects"][0]["object"]
    one.recognise(bench.sight(bench.BOX.at(0.30, 0.10, 0.3)), object=thing)
    end = _now()
    report(two, found, bench.held())
    places = len(engine.kb.match(None, RT.placementOf))
    asked = {"contributor": "nao-1", "since": begin, "until": end}
    done = engine.call("withdraw_contributor", asked, ANN).as_json()
    assert (done["attempts"], done["objects"], done["kept"]) == (0, 0, 1)
    assert [q.object.value for q in engine.kb.match(iri(found), RT.name)] == ["jar"]
    assert len(engine.kb.match(None, RT.placementOf)) < places
    (exemplar,) = {q.subject for q in engine.kb.match(None, RT.exemplarOf, iri(thing))}
    assert len(engine.kb.world.open_placements(exemplar.value)) == 1
    assert not engine.kb.validate()


def test_a_period_in_which_nothing_was_told_and_one_that_ends_early_are_refused(engine, robots):
    robots("nao-1")
    asked = {"contributor": "nao-1", "since": 10.0, "until": 20.0}
    with pytest.raises(UnknownTermError, match="told nothing then"):
        engine.call("withdraw_contributor", asked, ANN)
    with pytest.raises(UsageError, match="ends before it begins"):
        engine.call("withdraw_contributor", {**asked, "since": 30.0}, ANN)


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [5, pytest.param(20, marks=pytest.mark.deep)])
def test_four_robots_less_one_are_three(bench, rounds):
    """The graph equals one that the withdrawn robot never wrote to, where others did."""

    def told_by(names):
        with rtask.open(":memory:", base="https://example.org/kb/") as opened, Engine(opened) as e:
            made = [bench.Robot(name, e) for name in names]
            for robot in made:
                robot.register()
            rng = np.random.default_rng(0)
            teacher = bench.Robot("nao-0", e)
            teacher.register()
            thing = teacher.insert(bench.sight(bench.BOX))["objects"][0]["object"]
            for _ in range(rounds):
                for number in range(4):
                    held, x = bool(rng.random() < 0.6), 0.01 * int(rng.integers(2))
                    if f"nao-{number + 1}" in names:
                        robot = bench.Robot(f"nao-{number + 1}", e)
                        grasp = {**GRASP, "in_object": {**GRASP["in_object"], "x": x}}
                        report(robot, thing, bench.held() if held else bench.missed(), grasp)
            if "nao-4" in names:
                withdraw(e, "nao-4")
            counts = {}
            for q in opened.match(None, RT.executesGrasp):
                (pose,) = opened.match(q.object, RT.graspPose)
                (x,) = opened.match(pose.object, RT.x)
                key = x.object.value, newest(e, q.object.value)
                counts[key] = counts.get(key, 0) + 1
            return counts

    assert told_by(["nao-1", "nao-2", "nao-3", "nao-4"]) == told_by(["nao-1", "nao-2", "nao-3"])


def test_a_day_that_the_journal_no_longer_has_is_refused_and_nothing_is_withdrawn(
    tmp_path, monkeypatch
):
    """What is stored cannot be told from what came later: nothing may be taken for it."""
    monkeypatch.setattr("rtask.kb.durability.journal.SEGMENT_BYTES", 1_000)
    monkeypatch.setattr("rtask.kb.durability.journal._RETAINED_BYTES", 2_000)
    begin = dt.datetime.now(dt.UTC)
    with (
        rtask.open(tmp_path / "kb", base="https://example.org/kb/", reason=False, flush="os") as kb,
        Engine(kb) as engine,
    ):
        for number in range(12):
            kb.update(f"INSERT DATA {{ <urn:thing/{number}> <urn:p> '{'x' * 400}' }}", "nao-1")
        kb.checkpoint()
        oldest = kb.feed.oldest_retained()
        assert oldest > 1
        before = told(engine, "nao-1")
        asked = {"contributor": "nao-1", "since": begin.timestamp()}
        with pytest.raises(GoneError, match=f"commits before {oldest} are no longer kept") as error:
            engine.call("withdraw_contributor", asked, ANN)
        assert error.value.details["oldest"] == oldest
        with pytest.raises(GoneError):
            engine.call(
                "withdraw_contributor",
                {"contributor": "nao-1", "until": dt.datetime.now(dt.UTC).timestamp()}, ANN,
            )  # fmt: skip
        assert told(engine, "nao-1") == before
        # From the first commit that is kept on, the journal tells everything.
        first = kb.history(since=oldest - 1, upto=oldest)[0]
        kept = {"contributor": "nao-1", "since": moment(first.time).timestamp()}
        assert engine.call("withdraw_contributor", kept, ANN).as_json()["commit"]
        assert 0 < len(told(engine, "nao-1")) < len(before)
