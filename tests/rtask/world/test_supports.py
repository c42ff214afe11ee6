"""What was put on or into something stays there until a look says otherwise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rtask.engine import Engine
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from tests.rtask.world.conftest import BASE, Lab, pose

NAO = {
    "name": "nao-1", "model": "nao-h25-v5", "frames": ["base"],
    "end_effectors": [
        {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.06, "max_payload": 0.3}
    ],
}  # fmt: skip


def surface(name: str, x: float, y: float, side: float, rim: float = 0.0) -> dict[str, object]:
    at = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    return {"name": name, "pose": at, "length": side, "width": side, "rim_height": rim}


@pytest.fixture
def engine(lab: Lab) -> Iterator[Engine]:
    """The robot's box is 14 cm wide, at (0.2, 0.3); its table 60 cm, at (0.4, 0)."""
    with Engine(lab.kb) as engine:
        yield engine


@pytest.fixture
def places(lab: Lab, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> Lab:
    monkeypatch.setattr("rtask.engine.records.workplace.time", lambda: lab.noon - 60.0)
    given = [surface("left box", 0.2, 0.3, 0.14, 0.05), surface("table", 0.4, 0.0, 0.6)]
    engine.call("register_robot", {**NAO, "places": given})
    return lab


def last(lab: Lab, thing: str) -> tuple[str, str, bool]:
    """Return how a thing is related to which place, and whether its pose is known."""
    placement = lab.kb.world.last_placement(thing)
    assert placement is not None
    assert placement.is_current
    name = placement.place.rpartition("/")[2]
    return placement.relation, name, placement.frame_from_subject is not None


def test_a_look_into_the_box_keeps_a_thing_in_it_and_adds_its_pose(places: Lab) -> None:
    cup = places.see(places.cup, 0.5, 0.1, 0)
    places.put(cup, "held_by", places.hand(), 10)
    places.put(cup, "in", places.left_box, 20)
    assert places.see(places.cup, 0.22, 0.28, 30) == cup
    assert last(places, cup) == ("in", "left%20box", True)
    assert places.current(cup) == 1
    (answer,) = places.ask(cup, 40).exemplars
    assert (answer.relation, answer.place, answer.since_s) == (
        "in", places.left_box, places.noon + 20,
    )  # fmt: skip
    assert answer.frame_from_exemplar[:2, 3] == pytest.approx((0.22, 0.28))
    # Seen to have rolled to the other wall, it is in the box all the same.
    places.see(places.cup, 0.15, 0.34, 50, exemplar=cup)
    assert last(places, cup) == ("in", "left%20box", True)
    assert places.ask(cup, 60).exemplars[0].since_s == places.noon + 20


def test_a_look_beside_the_box_ends_that_a_thing_is_in_it(places: Lab) -> None:
    cup = places.see(places.cup, 0.5, 0.1, 0)
    places.put(cup, "in", places.left_box, 20)
    places.see(places.cup, 0.5, -0.1, 30, exemplar=cup)
    assert last(places, cup) == ("on", "table", True)
    places.put(cup, "in", places.left_box, 40)
    above = places.seen(places.cup, 0.2, 0.3, 50, exemplar=cup)
    above.frame_from_exemplar[2, 3] = 0.6  # on a shelf above
    edit = places.edit()
    edit.see(above)
    places.commit(edit, "nao-1")
    assert last(places, cup) == ("at", "", True)


def test_what_is_stated_of_a_thing_in_sight_keeps_its_pose(places: Lab, engine: Engine) -> None:
    table = places.left_box.replace("left%20box", "table")
    cup = places.see(places.cup, 0.5, 0.1, 0)
    stated = {"thing": cup, "stamp": places.noon + 10}
    engine.call("state_place", {**stated, "place": table})
    assert last(places, cup) == ("on", "table", True)
    # In the box it is not where it was seen, so somebody took it there.
    engine.call("state_place", {**stated, "place": places.left_box, "stamp": places.noon + 20})
    assert last(places, cup) == ("on", "left%20box", False)


def test_of_two_in_one_box_each_is_seen_once(places: Lab) -> None:
    first, second = (places.see(places.cup, 0.5, y, 0) for y in (0.1, -0.1))
    for thing in (first, second):
        places.put(thing, "held_by", places.hand(), 10)
        places.put(thing, "in", places.left_box, 20)
    edit = places.edit()
    seen = [edit.see(places.seen(places.cup, x, 0.3, 30)) for x in (0.15, 0.25)]
    places.commit(edit, "nao-1")
    assert sorted(seen) == sorted((first, second))
    assert {last(places, thing) for thing in seen} == {("in", "left%20box", True)}
    doubts = places.kb.world.doubts(seen[0])
    assert doubts == [(seen[1], 0.5)], "nobody knows which of the two is which"


def at_height(lab: Lab, x: float, y: float, z: float, time_s: float, sigma_m: float = 0.004) -> str:
    """See a cup at a height; return what it is on."""
    seen = replace(lab.seen(lab.cup, x, y, time_s), sigma_m=sigma_m)
    seen.frame_from_exemplar[2, 3] = z
    edit = lab.edit()
    thing = edit.see(seen)
    lab.commit(edit, "nao-1")
    return last(lab, thing)[1]


def test_what_is_seen_over_a_table_no_higher_than_it_is_tall_stands_on_it(places: Lab) -> None:
    places.kb.update(f"{PREFIXES} INSERT DATA {{ <{places.cup}> rt:extentZ 8.0e-2 }}")
    assert at_height(places, 0.5, 0.1, 0.04, 0) == "table"
    assert at_height(places, 0.68, 0.1, 0.04, 10) == "table"
    assert at_height(places, 0.72, 0.1, 0.04, 20) == ""  # beside it
    assert at_height(places, 0.5, -0.2, 0.2, 30) == ""  # in a hand, or on something else
    assert at_height(places, 0.4, -0.1, 0.04, 40, sigma_m=0.2) == ""  # anywhere about the table


def test_a_box_on_the_table_is_nearer_to_what_is_in_it_than_the_table(
    lab: Lab, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.engine.records.workplace.time", lambda: lab.noon - 60.0)
    given = [surface("tray", 0.4, 0.0, 0.2, 0.03), surface("table", 0.4, 0.0, 0.6)]
    engine.call("register_robot", {**NAO, "places": given})
    assert last(lab, lab.see(lab.cup, 0.45, 0.05, 0)) == ("in", "tray", True)
    assert last(lab, lab.see(lab.cup, 0.6, 0.05, 10)) == ("on", "table", True)


def test_of_two_robots_that_described_one_table_each_sees_things_on_its_own(lab: Lab) -> None:
    frame = f"{BASE}robot/nao-1/frame/base"
    for robot in ("nao-1", "panda-2"):
        lab.kb.update(
            f"{PREFIXES} INSERT DATA {{ <{BASE}robot/{robot}/place/table> a rt:SupportSurface ; "
            f"rt:bodyFrame <{frame}> ; rt:surfaceLength 2.0e0 ; rt:surfaceWidth 2.0e0 }}"
        )
    by_nao = replace(lab.seen(lab.cup, 0.5, 0.1, 0), robot=f"{BASE}robot/nao-1")
    by_other = replace(lab.seen(lab.cup, 0.5, 0.6, 10), robot=f"{BASE}robot/ur-3")
    for seen, place in ((by_nao, f"{BASE}robot/nao-1/place/table"), (by_other, "")):
        edit = lab.edit()
        thing = edit.see(seen)
        lab.commit(edit, "nao-1")
        placement = lab.kb.world.last_placement(thing)
        assert placement is not None
        assert placement.place == place


def test_a_table_that_is_described_later_has_what_is_seen_there_again(
    lab: Lab, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    cup = lab.see(lab.cup, 0.5, 0.1, 0)
    assert last(lab, cup) == ("at", "", True)
    monkeypatch.setattr("rtask.engine.records.workplace.time", lambda: lab.noon + 5.0)
    engine.call("register_robot", {**NAO, "places": [surface("table", 0.4, 0.0, 0.6)]})
    assert lab.see(lab.cup, 0.5, 0.1, 10) == cup
    assert last(lab, cup) == ("on", "table", True)


def test_where_nobody_knows_a_place_only_what_was_seen_contradicts_it(lab: Lab) -> None:
    lab.kb.update(f"{PREFIXES} INSERT DATA {{ <urn:shelf> a rt:SupportSurface ; rt:name 'shelf' }}")
    cup = lab.see(lab.cup, 0.3, 0.1, 0)
    lab.put(cup, "on", "urn:shelf", 10)
    assert lab.see(lab.cup, 0.301, 0.1, 20) == cup  # it stands where it stood
    assert last(lab, cup) == ("on", "urn:shelf", True)
    lab.see(lab.cup, 0.4, 0.1, 30, exemplar=cup)  # somebody shoved it
    assert last(lab, cup) == ("on", "urn:shelf", True)
    lab.see(lab.cup, 0.9, 0.1, 40, exemplar=cup)  # somebody took it away
    assert last(lab, cup) == ("at", "", True)


def test_a_table_does_not_walk_along_and_a_second_registration_changes_nothing(
    places: Lab, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {**NAO, "places": [surface("table", 0.4, 0.0, 0.6)]}
    places.stand(places.frame(), places.map, 1.0, 0.0, 0)
    monkeypatch.setattr("rtask.engine.records.workplace.time", lambda: places.noon + 10.0)
    engine.call("register_robot", given)
    assert engine.call("register_robot", given).as_json()["commit"] == ""
    places.stand(places.frame(), places.map, 3.0, 0.0, 50)
    frame = places.left_box.replace("place/left%20box", "frame/table")
    rooted = places.kb.world.frames.rooted(frame, places.noon + 60)
    assert rooted.root == places.map
    assert rooted.poses[-1][:2, 3] == pytest.approx((1.4, 0.0))
    with pytest.raises(UsageError, match=r"places\[1\]\.name: 'table' is given twice"):
        engine.call("register_robot", {**NAO, "places": given["places"] * 2})


def test_the_scene_has_tables_and_boxes_with_what_stands_in_them(places: Lab) -> None:
    cup = places.see(places.cup, 0.5, 0.1, 0)
    places.put(cup, "in", places.left_box, 20)
    scene = places.kb.world.scene(places.noon + 30)
    poses = {
        node.label: (node.kind, node.size_m, at)
        for node, at in zip(scene.nodes, scene.root_from_nodes(), strict=True)
        if node.kind in ("place", "thing")
    }
    assert set(poses) == {"left box", "table", "blue cup"}
    assert poses["left box"][:2] == ("place", (0.14, 0.14, 0.05))
    assert poses["table"][:2] == ("place", (0.6, 0.6, 0.0))
    assert np.allclose(poses["blue cup"][2], pose(0.2, 0.3))
    assert scene.unplaced == ()


def test_what_lies_in_a_box_goes_where_the_box_goes_though_a_robot_measured_it(lab: Lab) -> None:
    crate = f"{BASE}place/crate"
    lab.kb.update(
        f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
        <{BASE}frame/crate> a rt:Frame ; rt:frameId "crate" .
        <{crate}> a rt:SupportSurface ; rt:bodyFrame <{BASE}frame/crate> ;
          rt:surfaceLength 0.4e0 ; rt:surfaceWidth 0.3e0 ; rt:rimHeight 0.2e0 }} }}"""
    )
    lab.stand(lab.frame(), lab.map, 0.0, 0.0, -10)
    lab.stand(f"{BASE}frame/crate", lab.map, 1.0, 0.0, -10)
    cup = lab.see(lab.cup, 0.5, 0.0, 0)
    lab.put(cup, "in", crate, 10)
    lab.see(lab.cup, 1.05, 0.02, 20)  # a look into the crate
    lab.stand(f"{BASE}frame/crate", lab.map, 3.0, 1.0, 100)
    [then], [now] = (lab.ask("blue cup", t, frame="map").exemplars for t in (90, 110))
    assert then.frame_from_exemplar[:2, 3] == pytest.approx([1.05, 0.02])
    assert now.frame_from_exemplar[:2, 3] == pytest.approx([3.05, 1.02])
    assert lab.see(lab.cup, 3.05, 1.02, 120) == cup
    drawn = next(n for n in lab.kb.world.scene(lab.noon + 130).nodes if n.iri == cup)
    assert drawn.facts["relation"] == "in"


def test_a_cup_on_a_tray_is_carried_with_it_and_nowhere_while_nobody_knows_of_the_tray(
    lab: Lab,
) -> None:
    lab.stand(lab.frame(), lab.map, 0.0, 0.0, -10)
    tray, cup = lab.see(lab.box, 0.5, 0.0, 0), lab.see(lab.cup, 0.55, 0.0, 0)
    lab.put(cup, "on", tray, 10)
    lab.see(lab.cup, 0.56, 0.03, 20, exemplar=cup)
    lab.put(tray, "held_by", lab.hand(), 30)
    [carried] = lab.ask("blue cup", 40).exemplars
    assert (carried.place, carried.frame_from_exemplar, carried.radius90_m) == (tray, None, None)
    lab.see(lab.box, 0.9, 0.4, 50, exemplar=tray)
    [put] = lab.ask("blue cup", 60, frame="map").exemplars
    assert put.frame_from_exemplar[:2, 3] == pytest.approx([0.96, 0.43])
    assert lab.see(lab.cup, 0.96, 0.43, 70) == cup
