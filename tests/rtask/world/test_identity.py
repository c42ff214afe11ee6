"""Which thing of a product is seen: by place, time and what happened to it."""

from __future__ import annotations

import pytest

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri
from rtask.world.identities.identity import Candidate, identify
from rtask.world.uncertainty import Spread

HERE = Spread(0.005, 1.0, 0.35)


def test_a_thing_that_is_seen_where_it_was_is_the_same(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    assert lab.see(lab.cup, 0.301, 0.1, 5) == first
    assert len(lab.kb.world.history(first)) == 1


def test_two_at_once_are_two_things_of_one_product(lab):
    first, second = lab.see(lab.cup, 0.3, 0.1, 0), lab.see(lab.cup, 0.3, -0.2, 0)
    assert first != second
    assert lab.kb.world.exemplars_of(lab.cup) == sorted([first, second])
    assert lab.kb.world.doubts(second) == []


def test_two_in_one_commit_are_two_things(lab):
    edit = lab.edit()
    exemplars = [edit.see(lab.seen(lab.cup, 0.3, y, 0)) for y in (0.1, -0.2, 0.1)]
    lab.commit(edit, "nao-1")
    assert len(set(exemplars)) == 2
    assert exemplars[0] == exemplars[2]


def test_two_robots_with_a_table_each_see_two_things(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    assert lab.see(lab.cup, 0.3, 0.1, 5, robot="nao-2") != first


def test_two_robots_in_one_map_see_one_thing(lab):
    lab.stand(lab.frame("nao-1"), lab.map, 0.0, 0.0, -100)
    lab.stand(lab.frame("nao-2"), lab.map, 1.0, 0.0, -100)
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    assert lab.see(lab.cup, -0.7, 0.1, 5, robot="nao-2") == first
    assert lab.current(first) == 1


def test_a_thing_that_its_robot_lost_is_the_same_when_it_is_seen_again(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.lose(first, 10)
    assert lab.see(lab.cup, 0.5, -0.1, 20) == first
    assert [p.is_current for p in lab.kb.world.history(first)] == [False, True]


def test_a_thing_in_the_hand_that_is_seen_on_the_table_was_put_down(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(first, "held_by", lab.hand(), 10)
    assert lab.see(lab.cup, 0.5, -0.1, 20) == first
    assert lab.current(first) == 1


def test_a_thing_that_nobody_moved_may_have_been_carried_by_an_unseen_hand(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    second = lab.see(lab.cup, 0.6, -0.4, 2 * 3600)
    assert second != first
    ((other, chance),) = lab.kb.world.doubts(second)
    assert other == first
    assert 0.1 < chance < 0.9


def test_a_thing_that_is_still_there_is_not_the_one_that_was_seen_elsewhere(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    second = lab.see(lab.cup, 0.6, -0.4, 2 * 3600)
    assert lab.see(lab.cup, 0.3, 0.1, 2 * 3600 + 90) == first
    assert lab.kb.world.doubts(second) == []


def test_a_second_cup_beside_one_in_the_box_is_another_one(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(first, "in", lab.left_box, 10)
    second = lab.see(lab.cup, 0.3, 0.1, 20)
    assert second != first
    assert lab.ask(first, 30).exemplars[0].place == lab.left_box


def test_an_old_report_says_where_a_thing_was_then_and_changes_nothing_of_now(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.see(lab.cup, 0.3, 0.1, 100)
    lab.see(lab.cup, 0.9, 0.1, 300, exemplar=first)
    assert lab.see(lab.cup, 0.31, 0.1, 200) == first  # it stood there still: no other one is made
    assert lab.see(lab.cup, -0.5, 0.0, -100, exemplar=first) == first
    now = lab.ask("blue cup", 400).exemplars
    assert [place.frame_from_exemplar[0, 3] for place in now] == [pytest.approx(0.9)]
    spots = [p.frame_from_subject[0, 3] for p in lab.kb.world.history(first)]
    assert spots == pytest.approx([-0.5, 0.3, 0.9])
    assert lab.current(first) == 1


def test_what_was_seen_later_at_its_place_is_not_moved_by_an_older_report(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.see(lab.cup, 0.3, 0.1, 1000)
    lab.see(lab.cup, 0.9, 0.1, 500, exemplar=first)
    lab.put(first, "held_by", lab.hand("nao-2"), 600, robot="nao-2")
    lab.lose(first, 700)
    (place,) = lab.ask("blue cup", 1100).exemplars
    assert (place.relation, place.seen_s) == ("at", lab.noon + 1000)


def test_a_deed_that_is_told_late_stands_between_those_that_are_known(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(first, "held_by", lab.hand("nao-2"), 130, robot="nao-2")
    lab.put(first, "held_by", lab.hand("nao-1"), 90)
    held = [lab.ask("blue cup", t).exemplars[0].place for t in (80, 100, 140)]
    assert held == ["", lab.hand("nao-1"), lab.hand("nao-2")]
    lab.lose(first, 60)  # gone from the table before anybody says that it was taken
    assert not lab.ask("blue cup", 70).is_known


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_in_one_look_each_is_another_thing_in_whatever_order_it_is_told(lab, order):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    long_s = 40 * 3600  # so long that all of the table is about where the cup was
    spots = [(0.3, 0.1), (0.6, 0.1), (0.601, 0.1)]
    edit = lab.edit()
    told = edit.see_all([lab.seen(lab.cup, *spots[k], long_s) for k in order])
    lab.commit(edit, "nao-1")
    things = dict(zip(order, told, strict=True))
    assert things[0] == first
    assert things[1] == things[2] != first  # one cup that was taken for two


def test_two_equal_cups_of_which_one_was_pushed_are_told_apart_by_the_nearer_one(lab):
    one, other = lab.see(lab.cup, 0.3, 0.1, 0), lab.see(lab.cup, 0.45, 0.1, 0)
    edit = lab.edit()
    long_s = 40 * 3600
    look = [lab.seen(lab.cup, x, 0.1, long_s) for x in (0.38, 0.45)]
    assert edit.see_all(look) == [one, other]


def test_of_three_in_sight_of_which_two_were_lost_each_may_be_either(lab):
    lost = {lab.see(lab.cup, x, 0.1, 0) for x in (0.3, 0.5)}
    for thing in sorted(lost):
        lab.lose(thing, 60)
    edit = lab.edit()
    seen = edit.see_all([lab.seen(lab.cup, x, -0.2, 120) for x in (-0.3, 0.0, 0.3)])
    lab.commit(edit, "nao-1")
    (new,) = set(seen) - lost
    assert {name for name, _ in lab.kb.world.doubts(new)} == lost
    edit = lab.edit()
    edit.see_all([lab.seen(lab.cup, x, -0.2, 600) for x in (-0.3, 0.0, 0.3)])
    lab.commit(edit, "nao-1")
    for thing in lost:  # which is which stays open, though all are where they were
        assert new in dict(lab.kb.world.doubts(thing))


def test_bodies_that_would_overlap_are_one_thing():
    near = Candidate("urn:a", 0.07, HERE, is_current=True, age_s=5.0)
    assert identify([near], 0.003, min_extent_m=0.08).exemplar == "urn:a"
    assert identify([near], 0.003, min_extent_m=0.05).exemplar == ""


def test_between_two_lost_things_the_nearer_one_is_taken_and_the_doubt_is_kept():
    lost = [Candidate(f"urn:{k}", d, HERE, is_current=False) for k, d in enumerate((0.4, 0.2))]
    identity = identify(lost, 0.003)
    assert identity.exemplar == "urn:1"
    assert identity.doubts == (("urn:0", 0.5),)


def test_what_slipped_from_a_hand_is_likelier_than_what_an_unseen_hand_took():
    gone = Candidate("urn:0", 0.2, HERE, is_current=False)
    slipped = Candidate("urn:1", None, HERE, is_current=False, has_slipped=True)
    identity = identify([gone, slipped], 0.003)
    assert identity.exemplar == "urn:1"
    assert identity.doubts == (("urn:0", pytest.approx(0.2)),)


def test_a_thing_is_the_same_if_nothing_else_is_likely():
    gone = Candidate("urn:a", 1.0, Spread(0.01, 0.0, 0.1), is_current=True, age_s=1e6)
    assert identify([gone], 0.003).doubts == (("urn:a", pytest.approx(1 / 1.1)),)


def test_a_thing_seen_elsewhere_before_it_was_missed_turns_out_to_be_the_same(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    carried = lab.see(lab.cup, 0.9, -0.4, 600)
    assert carried != first
    lab.lose(first, 900)
    assert lab.kb.world.exemplars_of(lab.cup) == [first]
    (place,) = lab.ask("blue cup", 950).exemplars
    assert place.frame_from_exemplar[0, 3] == pytest.approx(0.9)
    assert place.doubts == ()
    before, after = lab.kb.world.history(first)
    assert before.end == after.begin, "it is at one place at a time"


def test_of_two_lost_things_none_is_taken_for_the_one_that_was_seen_elsewhere(lab):
    lab.stand(lab.frame(), lab.map, 0.0, 0.0, -100)
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    second = lab.see(lab.cup, -0.6, 0.1, 0)
    third = lab.see(lab.cup, 0.9, -0.4, 600)
    edit = lab.edit()
    edit.lose_all([first, second], lab.noon + 900)
    lab.commit(edit, "nao-1")
    assert lab.kb.world.exemplars_of(lab.cup) == sorted([first, second, third])
    assert {name for name, _ in lab.kb.world.doubts(third)} == {first, second}


def test_a_doubt_between_two_lost_things_is_mutual_when_the_other_comes_back(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    second = lab.see(lab.cup, -0.6, 0.1, 0)
    edit = lab.edit()
    edit.lose_all([first, second], lab.noon + 900)
    lab.commit(edit, "nao-1")
    back = lab.see(lab.cup, 0.0, 0.4, 1000)
    other = lab.see(lab.cup, 0.9, 0.4, 1100)
    assert {back, other} == {first, second}
    doubts = {name: dict(lab.kb.world.doubts(name)) for name in (back, other)}
    assert doubts == {back: {other: 0.5}, other: {back: 0.5}}, "nobody can tell which is which"


def test_which_of_two_came_back_stays_open_from_then_on_though_they_are_two(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    second = lab.see(lab.cup, -0.6, 0.1, 0)
    edit = lab.edit()
    edit.lose_all([first, second], lab.noon + 900)
    lab.commit(edit, "nao-1")
    back = lab.see(lab.cup, 0.0, 0.4, 1000)
    other = lab.see(lab.cup, 0.9, 0.4, 1100)
    assert lab.see(lab.cup, 0.0, 0.4, 1500) == back
    assert lab.kb.match(iri(other), RT.distinctFrom, iri(back)), "both were seen at once"
    for time_s, doubts in ((500, ()), (1600, ((other, 0.5),))):
        (place,) = lab.ask(back, time_s).exemplars
        assert place.doubts == doubts


def test_a_new_thing_is_no_other_once_that_is_seen_where_it_always_was(lab):
    first = lab.see(lab.cup, 0.3, 0.1, 0)
    new = lab.see(lab.cup, 0.9, -0.4, 3600)
    assert [name for name, _ in lab.kb.world.doubts(new)] == [first]
    lab.see(lab.cup, 0.3, 0.1, 3700)
    assert lab.kb.world.doubts(new) == []


def test_what_slipped_from_the_hand_of_one_robot_is_the_same_to_another_at_its_table(lab):
    for robot in ("nao-1", "nao-2"):
        lab.stand(lab.frame(robot), lab.map, 0.0, 0.0, -100)
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(cup, "held_by", lab.hand(), 10)
    lab.lose(cup, 20)
    assert lab.see(lab.cup, 0.5, 0.3, 40, robot="nao-2") == cup


def test_what_slipped_at_one_table_is_not_surely_the_one_that_is_seen_at_another(lab):
    for robot, x in (("nao-1", 0.0), ("nao-2", 3.0)):
        lab.stand(lab.frame(robot), lab.map, x, 0.0, -100)
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(cup, "held_by", lab.hand(), 10)
    lab.lose(cup, 20)
    other = lab.see(lab.cup, 0.5, 0.3, 40, robot="nao-2")
    assert other != cup
    ((name, chance),) = lab.kb.world.doubts(other)
    assert (name, chance) == (cup, pytest.approx(0.25 / 0.35))
    assert lab.see(lab.cup, 0.5, 0.3, 60) == cup, "it lies where it fell"
