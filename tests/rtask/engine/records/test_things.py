"""Products and things: what robots share, and the specimens that stand on their tables."""

from __future__ import annotations

import pytest

import rtask
from grasp.messages import pose_message
from grasp.spatial.frames import surface_from_object
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, PROV, RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow


@pytest.fixture
def kb():
    """Return a store with a reasoner, so that things inherit."""
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


def given(bench, x, y, stamp=None):
    """Return a view of the box with the pose that the robot itself found."""
    pose = pose_message(surface_from_object(x, y, bench.TABLE, 0.3))
    seen = {**bench.sight(bench.BOX), "object_pose": pose}
    return seen if stamp is None else {**seen, "stamp": stamp}


def test_what_robots_share_is_the_product_and_what_stands_here_a_thing(kb, engine, robots, bench):
    one, two = robots("nao-1"), robots("nao-2")
    stored = one.insert(bench.sight(bench.BOX), name="tea")["objects"][0]
    product, first = stored["object"], stored["thing"]
    assert one.recognise(bench.sight(bench.BOX))["thing"] == first, "it stands where it stood"
    answer = two.recognise(bench.sight(bench.BOX))
    assert answer["object"] == product, "the product is shared"
    second = answer["thing"]
    assert second not in ("", first), "two tables, two things"
    assert kb.world.exemplars_of(product) == sorted([first, second])

    beside = one.recognise(given(bench, 0.30, 0.10, _now()), object=product)["thing"]
    assert beside not in (first, second), "two at once are two"

    told = two.call(
        "report_outcome", object=product, task_id=answer["task_id"],
        grasp=dict(answer["grasps"][0]), gripper_id=two.gripper,
        outcome={"success": True, "placed": True, "reason": "ok", "place": "left box"},
    )  # fmt: skip
    assert told["thing"] == second
    (attempt,) = kb.match(None, RT.handlesExemplar)
    assert attempt.object == iri(second)
    assert kb.match(None, RT.handles, iri(product)), "the outcome names both"

    where = {place.exemplar: place for place in kb.world.where_is("tea").exemplars}
    assert [where[thing].relation for thing in (first, beside, second)] == ["at", "at", "in"]
    (place,) = (quad.object for quad in kb.match(iri(second), RT.locatedOn))
    assert place.value == where[second].place
    assert not kb.match(iri(product), RT.locatedOn), "a product is nowhere"
    assert len(kb.match(iri(first), RT.currentPose)) == 1
    assert not kb.match(iri(second), RT.currentPose), "its pose ended when it was taken"

    kb.update(f"""{PREFIXES}
INSERT DATA {{ GRAPH <{kb.base}graph/shared> {{ <{product}> rt:mass 0.2e0 }} }}""")
    rows = kb.select(f"""{PREFIXES}
SELECT DISTINCT ?mass ?grasp {{ <{second}> rt:effectiveMass ?mass ; rt:hasGrasp ?grasp }}""")
    assert {row.value("mass") for row in rows} == {0.2}
    assert {str(row.value("grasp")) for row in rows} == {told["grasp"]}, "things inherit"
    assert kb.match(iri(second), RT.effectiveGraspWidth)
    assert not kb.validate()

    one.call("resolve_request", wanted="box", gripper_id=one.gripper)
    engine.call("withdraw_contributor", {"contributor": "nao-2"}, Access("ann", "teacher"))
    assert {place.exemplar for place in kb.world.where_is("tea").exemplars} == {first, beside}
    engine.call(
        "curate_object", {"operation": "forget", "object": product}, Access("ann", "teacher")
    )
    assert not kb.match(None, RT.placementOf)
    assert not kb.match(None, RT.exemplarOf)


def test_what_one_robot_does_leaves_the_things_of_the_others_where_they_are(kb, robots, bench):
    """Two robots at two tables see one product, of which the first has two; it moves one."""
    one, two = robots("nao-1"), robots("nao-2")
    product = one.insert(bench.sight(bench.BOX), name="tea")["objects"][0]["object"]
    time_s = _now()
    left, right = (
        one.recognise(given(bench, x, y, time_s + k), object=product)["thing"]
        for k, (x, y) in enumerate([(0.16, -0.06), (0.30, 0.10)], 1)
    )
    other = two.recognise(given(bench, 0.16, -0.06, time_s + 3), object=product)["thing"]
    assert len({left, right, other}) == 3
    before = kb.seq
    again = [
        one.recognise(given(bench, x, y, time_s + k), object=product)["thing"]
        for k, (x, y) in enumerate([(0.16, -0.06), (0.30, 0.10)], 4)
    ]
    assert (again, kb.seq) == ([left, right], before), "two equal things that stay are no news"

    answer = one.recognise(given(bench, 0.16, -0.06, time_s + 6), object=product)
    told = one.call(
        "report_outcome", object=product, task_id=answer["task_id"],
        grasp=dict(answer["grasps"][0]), gripper_id=one.gripper,
        outcome={"success": True, "placed": True, "place": "left box", "ended": time_s + 9},
    )  # fmt: skip
    assert told["thing"] == left
    assert kb.seq == before + 1, "the end of one place and the begin of the next are one commit"
    places = kb.world.where_is("tea", at=time_s + 10).exemplars
    relations = {place.exemplar: place.relation for place in places}
    assert relations == {left: "in", right: "at", other: "at"}
    estimated = {
        quad.object.value: bool(kb.match(quad.subject, PROV.invalidatedAtTime))
        for quad in kb.match(None, RT.poseOfExemplar)
    }
    assert estimated == {left: True, right: False, other: False}
    for thing in (left, right, other):
        assert len(kb.match(iri(thing), RT.currentPlacement)) == 1
    assert not kb.match(iri(product), RT.currentPose), "a product is nowhere"

    wanted = one.call("resolve_request", wanted="box", gripper_id=one.gripper)
    assert (wanted["object"], wanted["thing"]) == (product, right), "its own, not the other's"
    wanted = two.call("resolve_request", wanted="box", gripper_id=two.gripper)
    assert wanted["objects"][0]["thing"] == other
    assert not kb.validate()


def test_of_two_places_without_an_end_the_later_one_counts(kb, engine, robots, bench):
    one, two = robots("nao-1"), robots("nao-2")
    stored = one.insert(bench.sight(bench.BOX), name="tea")["objects"][0]
    product, thing = stored["object"], stored["thing"]
    two.insert(bench.sight(bench.BOX), object=product, thing=thing)
    one.insert(bench.sight(bench.BOX), object=product, thing=thing)
    engine.call("withdraw_contributor", {"contributor": "nao-2"}, Access("ann", "teacher"))
    opened = kb.world.open_placements(thing)
    assert len(opened) == 2, "the end that nao-2 had given to the first one went with it"
    (current,) = kb.match(iri(thing), RT.currentPlacement)
    assert current.object.value == opened[-1].iri
    one.insert(bench.sight(bench.BOX.at(0.30, 0.10, 0.3)), object=product, thing=thing)
    assert len(kb.world.open_placements(thing)) == 1, "the next one that comes ends both"
    assert not kb.validate()


def test_a_failed_grasp_loses_the_thing_until_it_is_seen_again(kb, robots, bench):
    robot = robots("nao-1")
    thing = robot.insert(bench.sight(bench.BOX), name="tea")["objects"][0]["thing"]
    answer = robot.recognise(bench.sight(bench.BOX))
    robot.call(
        "report_outcome", object=answer["object"], task_id=answer["task_id"],
        grasp=dict(answer["grasps"][0]), gripper_id=robot.gripper, outcome=bench.missed(),
    )  # fmt: skip
    reply = robot.call("where_is", name="tea")
    assert (reply["known"], reply["things"][0]["thing"]) == (False, thing)
    assert "not known" in reply["text"]
    elsewhere = bench.BOX.at(0.20, -0.02, 0.3)
    assert robot.recognise(bench.sight(elsewhere))["thing"] == thing
    (place,) = robot.call("where_is", name=thing)["things"]
    assert place["relation"] == "at"
    assert place["pose"]["position"]["x"] == pytest.approx(0.20, abs=0.01)


def test_a_copy_tells_the_thing_that_its_server_will_know(kb, engine, robots, bench):
    robot = robots("nao-1")
    product = robot.insert(bench.sight(bench.BOX), name="tea")["objects"][0]["object"]
    records = []
    engine.context.pass_on = lambda record, author: records.append((record, author))
    seen = given(bench, 0.30, 0.10, _now())
    exemplar = robot.recognise(seen, object=product)["thing"]
    engine.context.pass_on = None
    (place,) = [record for record, _ in records if record["kind"] == "place"]
    assert place["exemplar"] == exemplar
    from rtask.engine.records.asked import keep, record_of

    for record, author in records:
        keep(engine.context, record_of(record), author)
    assert kb.match(iri(exemplar), RT.exemplarOf, iri(product))


def _now() -> float:
    import time

    return time.time()
