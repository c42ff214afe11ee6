"""Frames that robots and people declare and move, and poses asked in any of them at any instant."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from grasp.messages import pose_message
from rtask.engine import Engine
from rtask.errors import ConflictError, ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from tests.rtask.world.conftest import BASE, NOON, pose

NAO = Access("nao-1", "robot")
ANN = Access("ann", "teacher")


@pytest.fixture
def engine(lab) -> Iterator[Engine]:
    with Engine(lab.kb) as made:
        yield made


@pytest.fixture
def state(engine):
    """Return what states a frame at seconds after noon."""

    def state(frame, parent=None, at=None, time_s=0.0, access=ANN, **more):
        given = {} if parent is None else {"parent": parent, "pose": pose_message(pose(*at))}
        args = {"frame": frame, "stamp": NOON + time_s, **given, **more}
        return engine.call("state_frame", args, access)

    return state


@pytest.fixture
def locate(engine):
    def locate(frame, target=None, time_s=0.0, access=ANN):
        args = {"frame": frame, "stamp": NOON + time_s}
        return engine.call("locate_frame", args | ({"target": target} if target else {}), access)

    return locate


def at(answer):
    """Return x and y of the pose of an answer."""
    return pytest.approx((answer.pose["position"]["x"], answer.pose["position"]["y"]))


def test_a_tree_from_the_map_to_a_camera_is_asked_in_any_frame_at_any_instant(
    lab, engine, state, locate
):
    state("room", "map", (10.0, 0.0), -100)
    state("table", "room", (1.0, 0.0), -100)
    state("base", "table", (0.0, 0.5), -100, NAO)
    camera = state("camera", "base", (0.0, 0.1), -100, NAO, sigma=0.003)
    assert camera.frame == f"{BASE}frame/camera"
    state("table", "room", (2.0, 0.0), 50)
    assert at(locate("camera", "map", 0)) == (11.0, 0.6)
    assert at(locate("camera", "map", 60)) == (12.0, 0.6)
    assert at(locate("table", "camera", 60)) == (0.0, -0.6), "also downwards"
    answer = locate("camera", time_s=60)
    assert (answer.target, answer.sigma) == (lab.map, pytest.approx(0.003))
    assert answer.path[0] == camera.frame
    assert answer.path[-1] == lab.map
    cup = lab.see(lab.cup, 0.3, 0.0, 0, frame=lab.table)
    for frame, x in (("map", 12.3), ("room", 2.3), ("camera", 0.3)):
        args = {"name": cup, "frame": frame, "stamp": NOON + 60}
        (thing,) = engine.call("where_is", args, ANN).things
        assert thing.pose["position"]["x"] == pytest.approx(x)
        assert (thing.frame_id, thing.frame_reason) == (frame, "")


def test_what_stood_on_a_table_moves_along_also_if_a_robot_on_it_saw_it(lab, state):
    state("table", "map", (1.0, 0.0), -100)
    state("base", "table", (0.0, 0.5), -100, NAO)
    cup = lab.see(lab.cup, 0.3, 0.0, 0)
    state("table", "map", (3.0, 0.0), 50)
    state("base", "table", (0.2, 0.5), 60, NAO)
    (place,) = lab.ask(cup, 70, frame="map").exemplars
    assert place.frame_from_exemplar[:2, 3] == pytest.approx((3.3, 0.5))


def test_a_frame_that_did_not_move_keeps_its_interval(lab, state):
    first = state("table", "map", (1.0, 0.0), -100)
    assert state("table", "map", (1.0, 0.0), -50).commit == "", "a robot may repeat itself often"
    assert state("table", "map", (1.0005, 0.0), 0).commit, "it is confirmed once a minute"
    assert len(lab.kb.world.history(first.frame)) == 1
    state("table", "map", (1.1, 0.0), 10)
    assert len(lab.kb.world.history(first.frame)) == 2


def test_a_ring_is_refused_with_the_frames_in_it_now_or_later(lab, state, locate):
    state("room", "map", (1.0, 0.0), -100)
    state("table", "room", (1.0, 0.0), -100)
    with pytest.raises(UsageError, match="cannot stand in a ring: room in table in room, at 2025-"):
        state("room", "table", (0.0, 0.0), 0)
    with pytest.raises(UsageError, match="a ring: room in room"):
        state("room", "room", (0.0, 0.0), 0)
    state("room", lost=True, time_s=10)
    state("shelf", "map", (0.0, 0.0), -100)
    state("table", "shelf", (1.0, 0.0), 20)
    state("shelf", "room", (1.0, 0.0), 30)
    with pytest.raises(UsageError, match="room in table in shelf in room"):
        state("room", "table", (0.0, 0.0), 20)
    lab.stand(f"{BASE}frame/room", lab.table, 0.0, 0.0, 40)
    answer = locate("table", "map", 50)
    assert not answer.known
    assert "frames stand in a ring: table, shelf, room" in answer.text
    assert answer.pose is None


def test_two_parents_at_one_time_are_refused_and_not_known_where_they_are_stored(
    lab, state, locate
):
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
      <{lab.table}> rt:parentFrame <{lab.map}> ; rt:poseInParent <urn:p> .
      <urn:p> a rt:Pose ; rt:inFrame <{lab.map}> ; rt:x 2.0e0 ; rt:y 0.0e0 ; rt:z 0.0e0 ;
        rt:qx 0.0e0 ; rt:qy 0.0e0 ; rt:qz 0.0e0 ; rt:qw 1.0e0 }} }}""")
    assert at(locate("table", "map")) == (2.0, 0.0)
    state("room", "map", (5.0, 0.0), -100)
    with pytest.raises(ConflictError, match=r"table stands in map for ever .*in two frames"):
        state("table", "room", (0.0, 0.0), 0)
    room = f"{BASE}frame/room"
    lab.kb.update(f"{PREFIXES} INSERT DATA {{ <{lab.table}> rt:parentFrame <{room}> }}")
    assert "table stands in several frames at that time: map, room" in locate("table", "map").text


def test_two_placements_of_a_frame_that_began_together_are_not_decided(lab, locate):
    for parent, x in ((lab.map, 1.0), (lab.frame(), 2.0)):
        edit = lab.edit()
        edit.stand(lab.table, parent, pose(x, 0.0), NOON)
        lab.commit(edit, "nao-1")
        lab.kb.update(f"{PREFIXES} DELETE {{ GRAPH ?g {{ ?p time:hasEnd ?e }} }} "
                      f"WHERE {{ GRAPH ?g {{ ?p time:hasEnd ?e }} }}")  # fmt: skip
    assert "several frames at that time: map, base" in locate("table", "map", 5).text


def test_no_way_to_the_asked_frame_is_said_and_the_pose_left_as_it_was_measured(lab, engine):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    args = {"name": cup, "frame": "map", "stamp": NOON + 5}
    (thing,) = engine.call("where_is", args, ANN).things
    assert thing.frame == lab.frame()
    assert thing.frame_reason == "no frame leads from base to map: their roots are base and map"
    assert f"(not known in the frame asked for: {thing.frame_reason})" in thing.text


def test_a_lost_frame_is_not_known_from_then_on(state, locate):
    state("table", "map", (1.0, 0.0), -100)
    state("table", lost=True, time_s=10)
    assert locate("table", "map", 5).known
    assert not locate("table", "map", 15).known
    with pytest.raises(ConflictError, match="is when table came to where it stood last"):
        state("table", "map", (1.0, 0.0), -200)


def test_a_robot_moves_its_own_frames_and_shared_ones_but_no_other_robot(lab, state, locate):
    state("base", "map", (1.0, 0.0), 0, NAO)
    assert locate("base", access=NAO).frame == lab.frame("nao-1"), "its own frame of that name"
    with pytest.raises(ForbiddenError, match="on another robot's body than that of 'nao-1'"):
        state("nao-2/base", "map", (1.0, 0.0), 0, NAO)
    assert state("nao-2/base", "map", (4.0, 0.0), 0, ANN).frame == lab.frame("nao-2")
    assert at(locate("nao-2/base", "nao-1/base")) == (3.0, 0.0)
    state("nao-2/wrist", "nao-2/base", (0.1, 0.0), 0, Access("nao-2", "robot"))
    assert state("wrist", "map", (1.0, 0.0), 0, NAO).frame == f"{BASE}frame/wrist"


def test_what_cannot_be_stated_of_frames_says_why(state):
    with pytest.raises(UsageError, match="give parent and pose together"):
        state("table", pose=pose_message(pose(0, 0)))
    with pytest.raises(UnknownTermError, match="no frame 'attic'"):
        state("table", "attic", (0.0, 0.0))
    with pytest.raises(UnknownTermError, match="no robot 'nao-3'; did you mean"):
        state("nao-3/base", "map", (0.0, 0.0))
    with pytest.raises(UsageError, match="is no frame"):
        state(f"{BASE}object/1", "map", (0.0, 0.0))
    with pytest.raises(UsageError, match="s ahead of the clock here"):
        state("table", "map", (0.0, 0.0), 1e9)
    with pytest.raises(UsageError, match="s since 1970"):
        state("table", "map", (0.0, 0.0), -1e12)
    state("table", "map", (0.0, 0.0), 0)
    with pytest.raises(UsageError, match="table stands in map; give the frame"):
        state("table")


def test_a_table_that_was_pushed_makes_what_stood_on_it_less_sure(lab, state):
    state("table", "map", (1.0, 0.0), -100)
    cup = lab.see(lab.cup, 0.3, 0.0, 0, frame=lab.table)
    state("table", "map", (2.0, 0.0), 5)
    before, after = (lab.ask(cup, time_s).exemplars[0].still_there for time_s in (4, 6))
    assert after < 0.95 * before


def test_what_happens_near_a_thing_on_a_table_counts_in_the_frame_of_the_table(lab, state):
    state("table", "map", (1.0, 0.0), -100)
    cup = lab.see(lab.cup, 0.3, 0.1, 0, frame=lab.table)
    fresh = lab.ask(cup, 40).exemplars[0].still_there
    # The same numbers in the map are a metre away.
    lab.see(lab.box, 0.3, 0.2, 20, frame=lab.map)
    elsewhere = lab.ask(cup, 40).exemplars[0].still_there
    assert elsewhere == fresh
    lab.see(lab.box, 0.3, 0.2, 30, frame=lab.table)
    beside = lab.ask(cup, 40).exemplars[0]
    assert beside.still_there < 0.95 * fresh
    asked_in_map = lab.ask(cup, 40, frame="map").exemplars[0]
    assert asked_in_map.still_there == beside.still_there, "the frame of the answer is no matter"
    assert lab.ask(cup, 25).exemplars[0].still_there > beside.still_there, "that was before"


def test_a_robot_that_walked_sees_the_same_thing_and_others_may_confirm_it(lab, state):
    state("base", "map", (1.0, 0.0), -100, NAO)
    state("nao-2/base", "map", (2.0, 0.0), -100)
    cup = lab.see(lab.cup, 0.3, 0.0, 0)
    state("base", "map", (0.5, 0.0), 100, NAO)
    assert lab.see(lab.cup, 0.8, 0.0, 120) == cup, "where it was, from another side"
    assert lab.see(lab.cup, -0.7, 0.0, 200, robot="nao-2") == cup
    state("base", "map", (9.0, 0.0), 300, NAO)
    assert len(lab.kb.world.history(cup)) == 1
    (place,) = lab.ask(cup, 310, frame="map").exemplars
    assert place.frame_from_exemplar[0, 3] == pytest.approx(1.3)
    (place,) = lab.ask(cup, 310, frame="nao-1/base").exemplars
    assert place.frame_from_exemplar[0, 3] == pytest.approx(-7.7), "in its own frame, too"


@pytest.mark.parametrize("is_seen_by", ["nao-1", "nao-2"])
def test_a_cup_that_two_robots_know_by_a_map_each_is_one_once_the_maps_are_tied(lab, is_seen_by):
    maps = [f"{BASE}frame/map-{k}" for k in (1, 2)]
    for robot, map_ in zip(("nao-1", "nao-2"), maps, strict=True):
        lab.kb.update(f"{PREFIXES} INSERT DATA {{ <{map_}> a rt:Frame }}")
        lab.stand(lab.frame(robot), map_, 0.0, 0.0, -10)
    first = lab.see(lab.cup, 1.0, 0.0, 0)
    both = [lab.see(lab.cup, x, 0.0, 10, robot="nao-2") for x in (-1.0, 1.0)]
    untied = lab.ask(both[0], 20, frame=maps[0]).exemplars[0]
    assert untied.frame_reason
    assert len({first, *both}) == 3
    lab.stand(maps[1], maps[0], 2.0, 0.0, 30)
    tied = lab.ask(both[0], 40, frame=maps[0]).exemplars[0]
    assert tied.frame_from_exemplar[:2, 3] == pytest.approx([1.0, 0.0])
    x = {"nao-1": 1.0, "nao-2": -1.0}[is_seen_by]
    assert lab.see(lab.cup, x, 0.0, 50, robot=is_seen_by) == first
    assert {place.exemplar for place in lab.ask("blue cup", 60).exemplars} == {first, both[1]}
    assert lab.see(lab.cup, 1.0, 0.0, 70, robot="nao-2") == both[1]


def test_two_cups_of_one_look_stay_two_whatever_is_said_of_frames(lab):
    lab.stand(lab.table, lab.map, 0.0, 0.0, -10)
    lab.stand(lab.frame(), lab.map, 0.0, 0.0, -10)
    edit = lab.edit()
    one, other = edit.see_all([
        lab.seen(lab.cup, 0.5, 0.0, 0, frame=lab.table), lab.seen(lab.cup, 0.9, 0.0, 0),
    ])  # fmt: skip
    lab.commit(edit, "nao-1")
    lab.stand(lab.table, lab.map, 0.4, 0.0, 10)  # as if the first were where the other one is
    assert lab.see(lab.cup, 0.9, 0.0, 20) in (one, other)
    assert not any(lab.kb.world.is_merged(thing) for thing in (one, other))
