"""Places in time: one at a time, closed and opened together, resolved in any frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rtask.errors import UnknownTermError, UsageError
from rtask.kb.commit.commit import Request
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import Quad, object_term
from rtask.world.estimates import estimated_placements
from tests.rtask.world.conftest import pose

DAY_S = 86_400.0


def test_a_thing_is_at_one_place_at_any_instant(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(cup, "held_by", lab.hand(), 10)
    lab.put(cup, "in", lab.left_box, 20)
    history = lab.kb.world.history(cup)
    assert [(p.begin - lab.noon, p.relation) for p in history] == [
        (0, "at"), (10, "held_by"), (20, "in"),
    ]  # fmt: skip
    assert [p.end and p.end - lab.noon for p in history] == [10, 20, None]
    for time_s, relation in ((0, "at"), (9.9, "at"), (10, "held_by"), (25, "in")):
        assert lab.ask(cup, time_s).exemplars[0].relation == relation
    assert not lab.ask(cup, -1).is_known


def test_what_nobody_saw_may_still_be_stated_to_stand_somewhere(lab):
    lab.kb.update(
        f"{PREFIXES} INSERT DATA {{ <{lab.cup}> rt:locatedOn <urn:tray> . "
        "<urn:tray> rt:locatedOn <urn:table> . <urn:tray> rt:name 'tray' }"
    )
    answer = lab.ask(lab.cup, 0)
    assert not answer.is_known
    assert answer.text.endswith("nobody had seen it by then; it is stated to be on or in tray")
    assert answer.exemplars[0].place == "urn:tray"


def test_the_end_and_the_next_begin_are_one_commit(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    before = lab.kb.seq
    lab.put(cup, "in", lab.left_box, 20)
    assert lab.kb.seq == before + 1
    assert lab.current(cup) == 1


def test_another_robot_ends_a_place_without_writing_in_a_foreign_graph(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(cup, "held_by", lab.hand("nao-2"), 10, robot="nao-2")
    assert lab.current(cup) == 1
    (first, second) = lab.kb.world.history(cup)
    assert (first.agent, second.agent) == (lab.frame()[: -len("/frame/base")], second.agent)


def test_what_was_lost_is_not_known_with_its_last_place(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(cup, "in", lab.left_box, 10)
    lab.lose(cup, 20)
    answer = lab.ask("blue cup", 30)
    assert not answer.is_known
    assert "not known, last on or in left box" in answer.text


def test_a_place_is_asked_in_any_frame_of_its_tree_at_any_instant(lab):
    lab.stand(lab.table, lab.map, 2.0, 0.0, -100)
    cup = lab.see(lab.cup, 0.3, 0.1, 0, frame=lab.table)
    lab.stand(lab.table, lab.map, 5.0, 1.0, 50)
    for time_s, where in ((10, (2.3, 0.1)), (60, (5.3, 1.1))):
        (place,) = lab.ask(cup, time_s, frame="map").exemplars
        assert place.frame_id == "map"
        assert place.frame_from_exemplar[:2, 3] == pytest.approx(where)


def test_what_a_walking_robot_saw_stays_where_it_was(lab):
    lab.stand(lab.frame(), lab.map, 1.0, 0.0, -100)
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.stand(lab.frame(), lab.map, 3.0, 0.0, 50)
    (place,) = lab.ask(cup, 60, frame="map").exemplars
    assert place.frame_from_exemplar[:2, 3] == pytest.approx((1.3, 0.1))


def test_a_frame_of_another_tree_leaves_the_pose_as_it_was_measured(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    (place,) = lab.ask(cup, 5, frame="map").exemplars
    assert place.frame == lab.frame()


def test_a_frame_name_that_two_robots_use_needs_the_robot(lab):
    lab.see(lab.cup, 0.3, 0.1, 0)
    with pytest.raises(UsageError, match=r"2 frames are called 'base'.*nao-1/base"):
        lab.ask("blue cup", 5, frame="base")
    assert lab.ask("blue cup", 5, frame="nao-1/base").is_known
    with pytest.raises(UnknownTermError, match="no frame 'attic'"):
        lab.ask("blue cup", 5, frame="attic")


def test_uncertainty_grows_with_time_and_with_what_happens_nearby(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    fresh, old = (lab.ask(cup, time_s).exemplars[0] for time_s in (1, DAY_S))
    assert fresh.radius90_m < 0.01
    assert old.radius90_m > fresh.radius90_m
    assert old.still_there < fresh.still_there
    lab.see(lab.box, 0.3, 0.2, 30)
    disturbed = lab.ask(cup, 60).exemplars[0]
    assert disturbed.still_there < 0.95 < fresh.still_there
    lab.see(lab.cup, 0.3, 0.1, 100)
    seen = lab.ask(cup, 101).exemplars[0]
    assert seen.still_there > 0.99, "it was seen there since"
    assert seen.radius90_m > fresh.radius90_m, "but it may have been shifted, and its pose is older"


def test_near_a_place_a_robot_or_a_thing(lab):
    cup, box = lab.see(lab.cup, 0.3, 0.1, 0), lab.see(lab.box, 0.9, 0.1, 0)
    other = lab.see(lab.cup, 0.3, -0.3, 0)
    lab.put(other, "in", lab.left_box, 10)

    def near(name, radius_m=0.5):
        answer = lab.ask("blue cup", 20, near=name, radius_m=radius_m)
        return [exemplar.exemplar for exemplar in answer.exemplars]

    assert near("left box") == [other]
    assert near("nao-1") == [cup]
    assert near("nao-1", 0.2) == []
    assert near("tea box", 0.7) == near(box, 0.7) == [cup]
    with pytest.raises(UnknownTermError, match=r"nothing is called 'left bx'.*left box"):
        near("left bx")


def test_asked_by_kind_name_id_and_iri(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    for name in ("mug", "Mugs", "Blue Cup", "lab/1", lab.cup, cup):
        assert [exemplar.exemplar for exemplar in lab.ask(name, 5).exemplars] == [cup], name
    answer = lab.ask("red cup", 5)
    assert (answer.is_known, answer.exemplars) == (False, ())
    assert answer.text == 'not known: nothing is called "red cup"'


def test_a_thing_that_turned_out_to_be_another_one_brings_its_places_along(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    second = lab.see(lab.cup, 0.6, -0.4, 2 * 3600)
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{lab.kb.base}graph/shared> {{
      <{second}> rt:mergedInto <{first}> }} }}""")
    assert lab.kb.world.exemplars_of(lab.cup) == [first]
    (place,) = lab.ask("blue cup", 3 * 3600).exemplars
    assert place.frame_from_exemplar[0, 3] == pytest.approx(0.6)


def test_a_graph_without_things_answers_from_what_robots_estimated(lab):
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{lab.kb.base}graph/agent/nao-1> {{
      <urn:e> a rt:PoseEstimate ; rt:poseOf <{lab.cup}> ; rt:estimatedPose <urn:p> ;
        rt:poseConfidence 0.9e0 ; prov:wasAttributedTo <{lab.kb.base}robot/nao-1> .
      <urn:p> a rt:Pose ; rt:inFrame <{lab.frame()}> ; rt:x 0.4e0 ; rt:y 0.1e0 ; rt:z 0.0e0 ;
        rt:qx 0.0e0 ; rt:qy 0.0e0 ; rt:qz 0.0e0 ; rt:qw 1.0e0 ;
        rt:atTime "2025-11-28T12:00:00Z"^^xsd:dateTimeStamp }} }}""")
    (placement,) = estimated_placements(lab.kb, lab.cup)
    (place,) = lab.kb.world.where_is("blue cup", at=placement.begin + 5).exemplars
    assert (place.exemplar, place.agent, place.is_known) == ("", "nao-1", True)
    assert np.allclose(place.frame_from_exemplar[:2, 3], (0.4, 0.1))


def test_the_index_follows_commits_and_can_be_rebuilt(lab, monkeypatch):
    from rtask.world.index import PlacementIndex, sorted

    monkeypatch.setattr(sorted, "_MIN_TAIL", 3)
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    for k in range(1, 9):
        lab.lose(cup, 100 * k)
        lab.see(lab.cup, 0.3 + 0.1 * k, 0.1, 100 * k + 50)
    followed, rebuilt = lab.kb.world.index, PlacementIndex(lab.kb)
    assert followed.history(cup) == rebuilt.history(cup)
    assert len(followed) == len(rebuilt) == 9
    for time_s in np.arange(-25.0, 900.0, 25.0):
        assert followed.at(cup, lab.noon + time_s) == rebuilt.at(cup, lab.noon + time_s)
    rebuilt.close()


def test_things_beyond_those_looked_at_are_not_denied(lab):
    """The one near the place may be among those that were left out."""
    for k in range(3):
        lab.see(lab.cup, 0.3 + 0.4 * k, 0.1, k)
    whole = lab.ask("blue cup", 20)
    assert (len(whole.exemplars), whole.things_untried) == (3, 0)
    part = lab.ask("blue cup", 20, max_things=2)
    assert (len(part.exemplars), part.things_untried) == (2, 1)
    assert part.text.endswith("ask with max_things 3, or by a name of their own")
    far = lab.ask("blue cup", 20, max_things=2, near="tea box")
    assert (far.exemplars, far.things_untried) == ((), 1)
    assert far.text.startswith('not decided: none of the "blue cup" looked at is near "tea box"')


def test_frames_deeper_than_what_is_followed_leave_nearness_undecided(lab, monkeypatch):
    from rtask.world import frames

    lab.stand(lab.table, lab.map, 1.0, 0.0, 0)
    lab.stand(lab.frame(), lab.table, 0.5, 0.0, 0)
    cup = lab.see(lab.cup, 0.3, 0.1, 1)
    (near,) = lab.ask("blue cup", 5, near="map", radius_m=3.0).exemplars
    assert near.exemplar == cup
    monkeypatch.setattr(frames, "MAX_DEPTH", 1)
    answer = lab.ask("blue cup", 6, near="map", radius_m=3.0)
    assert (answer.exemplars, answer.things_untried) == ((), 1)
    assert answer.text.endswith("too many frames are between it and 1 of them to tell")


def test_what_came_and_went_near_a_place_is_counted_alike_before_and_after_sorting(lab):
    from rtask.world.index import PlacementIndex

    followed = lab.kb.world.index
    assert len(followed) == 0  # it follows from here on
    box = lab.see(lab.box, 0.3, 0.1, 0)
    cup = lab.see(lab.cup, 0.35, 0.1, 10)
    lab.lose(cup, 20)
    [placement] = lab.kb.world.history(box)
    rebuilt = PlacementIndex(lab.kb)
    for index in (followed, rebuilt):
        for since_s, until_s, radius_m, count in (
            (0, 30, 0.1, 2),  # the cup came and went
            (-5, 30, 0.1, 2),  # that the box came is no event near it
            (10, 30, 0.1, 1),  # since 10 s is after 10 s
            (0, 10, 0.1, 1),
            (0, 20, 0.1, 2),  # until 20 s is 20 s too
            (20, 30, 0.1, 0),
            (0, 30, 0.04, 0),
        ):
            window_s = lab.noon + since_s, lab.noon + until_s
            spot = placement.frame_from_subject[:3, 3]
            found = index.events_near(box, placement.frame, spot, window_s, radius_m)
            assert len(found) == count, (index is followed, since_s, until_s, radius_m)
    rebuilt.close()


def test_what_another_robot_did_nearby_makes_a_place_less_sure_also_after_it_walked_on(lab):
    lab.stand(lab.frame("nao-1"), lab.map, 0.0, 0.0, -10)
    lab.stand(lab.frame("nao-2"), lab.map, 1.0, 0.0, -10)
    cup = lab.see(lab.cup, 0.5, 0.0, 0)
    box = lab.see(lab.box, -0.4, 0.0, 10, robot="nao-2")  # 10 cm from the cup
    lab.stand(lab.frame("nao-2"), lab.map, 5.0, 0.0, 20)
    lab.lose(box, 30)
    spread = lab.kb.world.spread(lab.kb.world.last_placement(cup), lab.noon + 40)
    assert spread.still_there == pytest.approx((1 - 0.08) ** 2, abs=1e-3)


def test_the_index_sees_what_was_loaded_in_bulk(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    assert len(lab.kb.world.history(cup)) == 1
    edit = lab.edit("nao-2")
    edit.see(lab.seen(lab.cup, 0.9, 0.1, 60, exemplar=cup))
    graph = lab.kb.graphs.agent("nao-2")
    quads = [Quad(s, p, object_term(value), graph) for s, p, value in edit.statements]
    lab.kb.bulk_add(quads, graph, Request(lab.kb.access()))
    assert len(lab.kb.world.history(cup)) == 2


def test_a_place_that_was_read_is_read_again_once_anything_of_it_changed(lab):
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    (placement,) = lab.kb.world.history(cup)
    assert lab.kb.world.index.read(placement.iri) is lab.kb.world.history(cup)[0]
    lab.kb.update(f"""{PREFIXES} DELETE {{ GRAPH ?g {{ ?pose rt:x ?x }} }}
      INSERT {{ GRAPH ?g {{ ?pose rt:x 0.5e0 }} }}
      WHERE {{ GRAPH ?g {{ <{placement.iri}> rt:placementPose ?pose . ?pose rt:x ?x }} }}""")
    (changed,) = lab.kb.world.history(cup)
    assert changed.frame_from_subject[0, 3] == 0.5
    lab.lose(cup, 50)
    assert lab.kb.world.history(cup)[0].end == lab.noon + 50
    lab.stand(lab.frame(), lab.map, 1.0, 0.0, 0)
    (place,) = lab.ask(cup, 20, frame="map").exemplars
    lab.kb.update(f"""{PREFIXES} DELETE {{ GRAPH ?g {{ ?pose rt:x ?x }} }}
      INSERT {{ GRAPH ?g {{ ?pose rt:x 2.0e0 }} }}
      WHERE {{ GRAPH ?g {{ ?p rt:placementOf <{lab.frame()}> ; rt:placementPose ?pose .
        ?pose rt:x ?x }} }}""")
    (moved,) = lab.ask(cup, 20, frame="map").exemplars
    shift = moved.frame_from_exemplar[0, 3] - place.frame_from_exemplar[0, 3]
    assert shift == pytest.approx(1.0), "the robot stood elsewhere than was stated at first"


def _walked(world, placement, thing=""):
    """Return the arrival by walking through each placement."""
    while True:
        before = world.last_placement(
            thing or placement.subject, np.nextafter(placement.begin, -np.inf)
        )
        if before is None or not placement.follows(before):
            return placement
        placement = before


def test_an_arrival_is_found_without_walking_wherever_the_run_is_sorted_or_was_changed(
    lab, monkeypatch
):
    from rtask.world.index import PlacementIndex, sorted

    monkeypatch.setattr(sorted, "_MIN_TAIL", 7)
    rng = np.random.default_rng(4)
    first, other = lab.see(lab.cup, 0.3, 0.1, 0), lab.see(lab.cup, 0.9, 0.1, 0)
    assert first != other
    for k in range(1, 60):
        thing, place = (first, lab.left_box) if rng.random() < 0.7 else (other, lab.hand())
        draw = rng.random()
        if draw < 0.15:
            lab.lose(thing, 10 * k)
        else:
            x = 0.3 if thing == first else 0.9
            place = lab.left_box if draw < 0.8 else place
            edit, placement = lab.edit(), lab.kb.world.last_placement(thing)
            pose_there = pose(x + 0.03 * (k % 3), 0.1)
            edit._close(thing, lab.noon + 10 * k)
            edit._open(replace(placement, iri=edit._node(), begin=lab.noon + 10 * k, end=None,
                               confirmed=lab.noon + 10 * k, relation="in", place=place,
                               frame=lab.frame(), frame_from_subject=pose_there))  # fmt: skip
            lab.commit(edit, "nao-1")
    world = lab.kb.world
    rebuilt = PlacementIndex(lab.kb)
    longest = 0
    for thing in (first, other):
        names = world.names_of(thing)
        for placement in world.history(thing):
            walked = _walked(world, placement)
            assert world.arrival(placement).iri == walked.iri
            assert rebuilt.arrival(names, placement) == walked.iri
            longest = max(longest, round((placement.begin - walked.begin) / 10))
    assert longest > 7, "runs are longer than the tail"
    rebuilt.close()
    lab.kb.update(f"INSERT DATA {{ GRAPH <{lab.kb.graphs.agent('nao-1').value}> {{ <{other}> "
                  f"<https://w3id.org/rtask-kg/ns#mergedInto> <{first}> }} }}")  # fmt: skip
    for placement in world.history(first):
        walked = _walked(world, placement, first)
        assert world.index.arrival(world.names_of(first), placement) == walked.iri


def test_a_question_about_a_long_stay_reads_a_few_of_its_places(lab, monkeypatch):
    from rtask.world.index import PlacementIndex
    from rtask.world.tracing import stays_of

    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    edit = lab.edit()
    for k in range(1, 400):
        edit._close(cup, lab.noon + 60 * k)
        edit._open(replace(lab.kb.world.last_placement(cup), iri=edit._node(), end=None,
                           begin=lab.noon + 60 * k, confirmed=lab.noon + 60 * k, relation="in",
                           place=lab.left_box))  # fmt: skip
    lab.commit(edit, "nao-1")
    read, reads = PlacementIndex.read, []
    monkeypatch.setattr(PlacementIndex, "read", lambda *args: reads.append(args) or read(*args))
    (place,) = lab.ask(cup, 30_000).exemplars
    assert place.since_s == lab.noon + 60
    assert len(reads) < 20
    reads.clear()
    stays, left_out = stays_of(lab.kb.world, cup, lab.noon + 30_000, 5)
    assert (len(stays), left_out, len(reads) < 40) == (5, 395, True)
    assert {stay.arrived_after_s for stay in stays} == {lab.noon + 60}
    moments = lab.kb.world.index.moments(lab.noon + 90)
    assert moments == (lab.noon, lab.noon + 60 * 399, lab.noon + 60, lab.noon + 120)
