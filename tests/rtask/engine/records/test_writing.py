"""Writes of the engine: each agent in its own graph, once, in the ontology's shapes."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

import ontology
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.terms import NamedNode

PREFIX = (
    "PREFIX rt: <https://w3id.org/rtask-kg/ns#> PREFIX prov: <http://www.w3.org/ns/prov#> "
    "PREFIX sosa: <http://www.w3.org/ns/sosa/> "
)


def tell(bench, robot, thing=None, **outcome):
    seen = bench.sight(thing or bench.BOX)
    answer = robot.recognise(seen)
    stored = robot.insert(
        seen, grasp=answer["grasps"][0], outcome=bench.held(**outcome), task_id=answer["task_id"]
    )
    return answer, stored


def test_everything_of_one_call_is_one_commit_in_the_robots_own_graph(bench, kb, robots):
    changes = []
    robot = robots()
    kb.on_commit(changes.append)
    tell(bench, robot)
    assert len(changes) == 1
    assert changes[0].graphs == {kb.graphs.agent("nao-1")}


@pytest.mark.slow
def test_the_second_robot_writes_about_the_firsts_object_into_its_own_graph(bench, kb, robots):
    one, two = robots("nao-1"), robots("nao-2")
    _, stored = tell(bench, one)
    before = kb.match(graph=kb.graphs.agent("nao-1"))
    answer = two.recognise(bench.sight(bench.BOX))
    two.insert(
        bench.sight(bench.BOX), object=stored["objects"][0]["object"],
        grasp=answer["grasps"][0], outcome=bench.held(), task_id=answer["task_id"],
    )  # fmt: skip
    assert kb.match(graph=kb.graphs.agent("nao-1")) == before
    thing = NamedNode(stored["objects"][0]["object"])
    views = kb.match(thing, NamedNode(ontology.NS + "hasView"), graph=kb.graphs.agent("nao-2"))
    assert len(views) == 1


def test_a_robot_cannot_register_or_write_for_another(bench, kb, engine, robots):
    robots("nao-1")
    intruder = Access("nao-2", "robot")
    with pytest.raises(ForbiddenError, match="nao-2"):
        engine.call("register_robot", bench.registration("nao-1", "right_hand"), intruder)
    before = kb.seq
    item = {**bench.sight(bench.BOX), "gripper_id": "right_hand", "outcome": bench.held()}
    with pytest.raises(ForbiddenError, match="right_hand of nao-1"):
        engine.call("insert_object", {"objects": [item]}, intruder)
    assert kb.seq == before


def test_a_reader_writes_nothing(bench, kb, engine):
    before = kb.seq
    with pytest.raises(ForbiddenError, match="scope write"):
        engine.call("insert_object", {"objects": [bench.sight(bench.BOX)]}, Access(None, "reader"))
    assert kb.seq == before


def test_the_same_task_stores_once(bench, kb, robots):
    robot = robots()
    answer, stored = tell(bench, robot)
    seq = kb.seq
    item = {
        **bench.sight(bench.BOX), "gripper_id": "right_hand", "grasp": answer["grasps"][0],
        "outcome": bench.held(), "task_id": answer["task_id"],
    }  # fmt: skip
    again = robot.call("insert_object", objects=[item])
    assert again["stored"] == 0
    assert kb.seq == seq
    for key in ("object", "grasp", "view", "class_iri", "label"):
        assert again["objects"][0][key] == stored["objects"][0][key]
    report = {
        "task_id": answer["task_id"], "object": stored["objects"][0]["object"],
        "grasp": answer["grasps"][0], "gripper_id": "right_hand", "outcome": bench.held(),
    }  # fmt: skip
    told = robot.call("report_outcome", **report)
    assert told["stored"] == 0
    assert told["statistics"]["attempts"] == 1


@pytest.mark.slow
def test_the_same_outcome_told_at_once_from_many_threads_stores_once(bench, kb, robots):
    robot = robots()
    tell(bench, robot)
    answer = robot.recognise(bench.sight(bench.BOX))
    results = []

    def report() -> None:
        results.append(
            robot.call(
                "report_outcome", task_id=answer["task_id"], object=answer["object"],
                grasp=answer["grasps"][0], gripper_id="right_hand", outcome=bench.held(),
            )["stored"]
        )  # fmt: skip

    threads = [threading.Thread(target=report) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(results) == [0, 0, 0, 0, 0, 1]


@pytest.mark.slow
def test_robots_that_ask_and_tell_at_once_do_not_disturb_each_other(bench, kb, robots):
    names = ("nao-1", "nao-2", "nao-3")
    all_robots = [robots(name) for name in names]
    things = [
        replace(bench.BOX, texture_seed=40 + k, size=(0.03 + 0.004 * k, 0.025, 0.04 + 0.01 * k))
        for k in range(3)
    ]
    seen = [bench.sight(thing) for thing in things]
    failures = []

    def work(robot, own) -> None:
        try:
            for k in range(4):
                answer = robot.recognise(seen[(own + k) % 3])
                if k == 0:
                    robot.insert(seen[own], grasp=answer["grasps"][0], outcome=bench.held(),
                                 task_id=answer["task_id"])  # fmt: skip
        except Exception as error:  # noqa: BLE001 - a thread's failure is this test's
            failures.append(error)

    threads = [threading.Thread(target=work, args=(r, k)) for k, r in enumerate(all_robots)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    rows = kb.select(
        PREFIX + "SELECT ?o ?id { ?o rt:objectId ?id ; rt:hasGrasp/^rt:executesGrasp ?a }"
    )
    assert len({row.value("id") for row in rows}) == len({row.value("o") for row in rows}) == 3


def test_two_robots_may_use_the_same_task_id_of_their_own_making(bench, robots):
    one, two = robots("nao-1"), robots("nao-2")
    _, stored = tell(bench, one)
    thing, grasp = stored["objects"][0]["object"], stored["objects"][0]["grasp"]
    for robot in (one, two):
        told = robot.call(
            "report_outcome", task_id="first try", object=thing, grasp=grasp,
            gripper_id="right_hand", outcome=bench.held(),
        )  # fmt: skip
        assert told["stored"] == 1
    assert told["statistics"]["attempts"] == 3


def test_one_bad_entry_refuses_all_and_is_named(bench, kb, robots):
    robot = robots()
    before = kb.seq
    good = {**bench.sight(bench.BOX), "gripper_id": "right_hand"}
    with pytest.raises(UsageError, match=r"objects\[1\]\.data: .*not a point cloud"):
        robot.call("insert_object", objects=[good, {**good, "data": "cHJpbnQoKQ=="}])
    with pytest.raises(UsageError, match=r"objects\[1\].*gripper_id"):
        robot.call("insert_object", objects=[good, {**good, "griper_id": "right_hand"}])
    with pytest.raises(UnknownTermError, match=r"objects\[0\].*urn:nothing"):
        robot.call("insert_object", objects=[{**good, "object": "urn:nothing"}])
    assert kb.seq == before


def test_counts_in_the_graph_follow_each_robots_outcomes(bench, kb, engine, robots):
    one, two = robots("nao-1"), robots("nao-2")
    _, stored = tell(bench, one)
    thing, grasp = stored["objects"][0]["object"], stored["objects"][0]["grasp"]
    out_of_reach = bench.missed(reason="ik")
    for robot, outcome in (
        (one, bench.missed()),
        (one, out_of_reach),
        (two, bench.held()),
        (two, bench.held()),
    ):
        robot.call("report_outcome", object=thing, grasp=grasp, gripper_id="right_hand",
                   outcome=outcome)  # fmt: skip
    query = (
        PREFIX
        + """SELECT ?who ?n ?k ?m { ?s rt:statisticsOf ?g ; prov:wasAttributedTo ?who ;
        rt:attempts ?n ; rt:successes ?k ; rt:meanSuccess ?m } ORDER BY ?who"""
    )
    counts = [(str(r.value("who"))[-5:], r.value("n"), r.value("k")) for r in kb.select(query)]
    assert counts == [("nao-1", 2, 1), ("nao-2", 2, 2)]
    engine.rebuild_statistics()
    again = [(str(r.value("who"))[-5:], r.value("n"), r.value("k")) for r in kb.select(query)]
    assert again == counts


def test_a_guessed_kind_says_how_sure_it_is(bench, kb, robots):
    tell(bench, robots(), bench.CAN)
    rows = kb.select(
        PREFIX
        + """PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#>
        SELECT ?class ?c { ?r rdf:reifies <<( ?o rdf:type ?class )>> ; rt:confidence ?c }"""
    )
    assert [(row["class"].value.split("#")[1], row.value("c")) for row in rows] == [
        ("Cylinder", 0.8)
    ]


def test_pictures_of_an_attempt_are_kept_by_phase(bench, kb, robots):
    tell(bench, robots(), images=[{"phase": "closed", "data": bench.png(1)},
                                  {"phase": "lifted", "data": bench.png(2)}])  # fmt: skip
    rows = kb.select(
        PREFIX
        + """SELECT ?phase ?blob { ?attempt a rt:GraspAttempt .
        ?picture prov:wasGeneratedBy ?attempt ; rt:name ?phase ; rt:hasBlob ?blob }
        ORDER BY ?phase"""
    )
    assert [row.value("phase") for row in rows] == ["closed", "lifted"]
    assert all(kb.blobs.read(row["blob"]).startswith(b"\x89PNG") for row in rows)


def test_the_attempt_carries_the_belief_and_the_times(bench, kb, robots):
    answer, _ = tell(bench, robots(), candidate_count=33, candidate_rank=2,
                     times={"planning_s": 0.2, "execution_s": 8.0})  # fmt: skip
    row = kb.select(
        PREFIX
        + """SELECT * { ?a a rt:GraspAttempt ; rt:priorAlpha ?alpha ;
        rt:priorBeta ?beta ; rt:analyticQuality ?q ; rt:candidateCount ?n ; rt:candidateRank ?k ;
        rt:planningTime ?plan ; rt:queryTime ?query ; rt:seed ?seed ; rt:simulated ?sim ;
        rt:usedRecognition/rt:matchCount ?matches }"""
    )[0]
    best = answer["grasps"][0]
    assert row.value("alpha") == pytest.approx(best["alpha"], abs=1e-6)
    assert row.value("beta") == pytest.approx(best["beta"], abs=1e-6)
    assert row.value("q") == pytest.approx(best["grasp_quality"], abs=1e-6)
    assert (row.value("n"), row.value("k"), row.value("seed")) == (33, 2, 5)
    assert row.value("plan") == 0.2
    assert row.value("query") > 0
    assert row.value("sim") is True
    assert row.value("matches") == 0


def test_a_success_that_was_lost_later_is_held_and_not_placed(bench, kb, robots):
    tell(bench, robots(), reason="slip_transport", placed=False)
    row = kb.select(
        PREFIX
        + """SELECT * { ?o rt:success ?s ; rt:placed ?p ; rt:hasReason/rt:code ?r ;
        rt:hasFeedback/rt:comment ?c }"""
    )[0]
    assert (row.value("s"), row.value("p"), row.value("r")) == (True, False, "ok")
    assert row.value("c") == "after holding: slip_transport"


def test_a_contradictory_outcome_is_refused(bench, robots):
    robot = robots()
    seen = bench.sight(bench.BOX)
    answer = robot.recognise(seen)
    with pytest.raises(UsageError, match="cannot have the reason ok"):
        robot.insert(seen, grasp=answer["grasps"][0], outcome={"success": False, "reason": "ok"})


def test_an_unknown_reason_is_kept_in_words(bench, kb, robots, caplog):
    robot = robots()
    seen = bench.sight(bench.BOX)
    answer = robot.recognise(seen)
    robot.insert(seen, grasp=answer["grasps"][0], outcome={"success": False, "reason": "gremlins"})
    row = kb.select(
        PREFIX + "SELECT * { ?o rt:hasReason/rt:code ?r ; rt:hasFeedback/rt:comment ?c }"
    )
    assert [(r.value("r"), r.value("c")) for r in row] == [("not_judged", "gremlins")]
    assert "gremlins" in caplog.text


@pytest.mark.slow
def test_the_same_grasp_found_again_is_one_grasp_in_the_graph(bench, kb, robots):
    one, two = robots("nao-1"), robots("nao-2")
    answer, stored = tell(bench, one)
    seen = bench.sight(bench.BOX, bench.Eye(noise_seed=9))
    again = two.insert(
        seen, object=stored["objects"][0]["object"], grasp=answer["grasps"][0],
        outcome=bench.held(),
    )  # fmt: skip
    assert again["objects"][0]["grasp"] == stored["objects"][0]["grasp"]


@pytest.mark.slow
def test_numbers_of_objects_go_on_after_a_restart(bench, kb, engine, robots):
    from rtask.engine import Engine

    _, first = tell(bench, robots())
    assert first["objects"][0]["object"].endswith("object/1")
    with Engine(kb) as later:
        robot = type(robots())("nao-1", later)
        seen = bench.sight(bench.CAN)
        assert robot.insert(seen)["objects"][0]["object"].endswith("object/2")
