"""Markers of the world for rviz, made with the messages of ROS 2's definitions."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from rtask.cli.ros.schema import engine_schema
from rtask.engine import Engine
from rtask.errors import RemoteUnavailableError, UnknownTermError
from rtask.interop.ros.convert import Make
from rtask.interop.ros.world_markers import WorldDisplay, world_markers
from tests.rtask.world.conftest import Lab, lab  # noqa: F401 - a fixture

pytest.importorskip("rosbags")
ADD, DELETE_ALL = 0, 3
CUBE, SPHERE, CYLINDER, TEXT = 1, 2, 3, 9


@pytest.fixture(scope="module")
def make() -> Make:
    from rtask.interop.ros.dds.types import RosTypes

    return RosTypes(engine_schema()).make


@pytest.fixture
def scene(lab: Lab) -> Iterator[dict[str, Any]]:  # noqa: F811
    """A table in a map, a cup of known size on it, and a box of unknown size on the floor."""
    lab.kb.update(
        f"PREFIX rt: <https://w3id.org/rtask-kg/ns#> INSERT DATA {{ <{lab.cup}> rt:extentZ 0.1e0 }}"
    )
    lab.stand(lab.table, lab.map, 2.0, 0.0, 0.0)
    lab.see(lab.cup, 0.3, 0.3, 10.0, frame=lab.table)
    lab.stand(lab.frame(), lab.map, 1.5, 0.0, 0.0)
    lab.see(lab.box, 0.5, 0.1, 10.0)
    with Engine(lab.kb) as engine:
        yield engine.call("show_world", {"stamp": lab.noon + 100.0}).as_json()


def by_namespace(array: Any) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for marker in array.markers[1:]:
        found.setdefault(marker.ns, []).append(marker)
    return found


def test_the_answer_has_frames_robots_and_things_in_the_root(
    lab: Lab,  # noqa: F811
    scene: dict[str, Any],
) -> None:
    assert (scene["root"], scene["frame_id"]) == (lab.map, "map")
    kinds = [node["kind"] for node in scene["nodes"]]
    assert sorted(kinds) == ["frame", "frame", "frame", "robot", "thing", "thing"]
    cup = next(n for n in scene["nodes"] if n["label"].startswith("blue cup"))
    assert [cup["pose"]["position"][a] for a in "xy"] == pytest.approx([2.3, 0.3])
    assert cup["size"] == [0.09, 0.08, 0.1]
    assert 0 < cup["radius90"] < 0.2
    assert 0.5 < cup["still_there"] <= 1


def test_tables_are_plates_and_boxes_have_rims(make: Make) -> None:
    pose = {"position": {"x": 1.0, "y": 0.0, "z": 0.5},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}  # fmt: skip
    nodes = [
        {"kind": kind, "node": "urn:p", "label": "p", "pose": pose, "size": size}
        for kind, size in (
            ("place", [0.6, 0.8, 0.0]), ("place", [0.2, 0.2, 0.1]), ("place", []), ("newer", []),
        )
    ]  # fmt: skip
    found = by_namespace(world_markers({"frame_id": "map", "nodes": nodes}, make))
    assert [(plate.scale.x, plate.scale.y) for plate in found["places"]] == [(0.6, 0.8), (0.2, 0.2)]
    (rim,) = found["rims"]
    assert {round(point.z, 6) for point in rim.points} == {0.0, 0.1}
    assert len(rim.points) == 16


def test_things_somewhere_in_a_box_are_names_one_above_the_other_without_a_body(make: Make) -> None:
    pose = {"position": {"x": 1.0, "y": 0.0, "z": 0.5},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}  # fmt: skip
    nodes = [
        {"kind": "thing", "node": f"urn:{name}", "label": name, "pose": pose, "size": [],
         "radius90": None, "still_there": 0.9, "somewhere": "somewhere in left box",
         "region": region}
        for name, region in (("cup", [0.3, 0.2, 0.1]), ("tea", [0.3, 0.2, 0.1]), ("pen", []))
    ]  # fmt: skip
    found = by_namespace(world_markers({"frame_id": "map", "nodes": nodes}, make))
    assert set(found) == {"regions", "thing names"}
    assert len(found["regions"]) == 2
    assert {round(point.z, 6) for point in found["regions"][0].points} == {0.1}
    heights = [label.pose.position.z for label in found["thing names"]]
    assert np.diff(heights).min() > 0.05
    assert found["thing names"][0].text == "cup: somewhere in left box 90%"


def test_more_nodes_than_asked_for_are_counted(lab: Lab, scene: dict[str, Any]) -> None:  # noqa: F811
    with Engine(lab.kb) as engine:
        asked = {"stamp": lab.noon + 100.0, "max_nodes": 2}
        few = engine.call("show_world", asked).as_json()
        assert (len(few["nodes"]), few["nodes_left_out"]) == (2, len(scene["nodes"]) - 2)
        with pytest.raises(UnknownTermError):
            engine.call("show_world", {"frame": "nowhere"})


def test_each_thing_is_a_box_on_its_place_above_a_disc_of_its_uncertainty(
    scene: dict[str, Any], make: Make
) -> None:
    array = world_markers(scene, make)
    assert array.markers[0].action == DELETE_ALL
    assert {m.action for m in array.markers[1:]} == {ADD}
    assert {m.header.frame_id for m in array.markers} == {"map"}
    assert {(m.header.stamp.secs, m.header.stamp.nsecs) for m in array.markers} == {(0, 0)}
    found = by_namespace(array)
    names = [(m.ns, m.id) for m in array.markers[1:]]
    assert len(names) == len(set(names)), "rviz would draw one over the other"
    (cup,) = [m for m in found["things"] if m.type == CUBE]
    (dot,) = [m for m in found["things"] if m.type == SPHERE]
    assert [cup.scale.x, cup.scale.y, cup.scale.z] == [0.09, 0.08, 0.1]
    # The place of a thing is the middle of its footprint, that of a box its centre.
    assert cup.pose.position.z == pytest.approx(0.05)
    assert dot.pose.position.z == pytest.approx(0.025)
    discs = {m.id: m for m in found["uncertainty"]}
    (node,) = [n for n in scene["nodes"] if n["size"]]
    assert discs[cup.id].type == CYLINDER
    assert discs[cup.id].scale.x == pytest.approx(2 * node["radius90"])
    label = next(m for m in found["thing names"] if m.id == cup.id)
    assert (label.type, label.text) == (TEXT, f"{node['label']} {node['still_there']:.0%}")


def test_a_thing_that_lies_on_its_side_is_drawn_on_its_side(
    scene: dict[str, Any], make: Make
) -> None:
    (node,) = [n for n in scene["nodes"] if n["size"]]
    half = float(np.sqrt(0.5))
    node["pose"]["orientation"] = {"x": 0.0, "y": half, "z": 0.0, "w": half}
    cup = next(m for m in by_namespace(world_markers(scene, make))["things"] if m.type == CUBE)
    assert cup.pose.position.x == pytest.approx(2.3 + 0.05)
    assert cup.pose.position.z == pytest.approx(0.0, abs=1e-9)


def test_the_less_sure_a_thing_is_still_there_the_paler_it_is(
    scene: dict[str, Any], make: Make
) -> None:
    (node,) = [n for n in scene["nodes"] if n["size"]]
    alphas = []
    for sure in (0.1, 0.9):
        node["still_there"] = sure
        found = by_namespace(world_markers(scene, make))["things"]
        alphas.append(next(m for m in found if m.type == CUBE).color.a)
    assert alphas[0] < 0.4 < 0.7 < alphas[1]


def test_frames_are_axes_and_robots_arrows(scene: dict[str, Any], make: Make) -> None:
    found = by_namespace(world_markers(scene, make))
    assert len(found["frames"]) == 3
    assert all(len(m.points) == len(m.colors) == 6 for m in found["frames"])
    assert {m.text for m in found["frame names"]} >= {"map", "table"}
    assert len(found["robots"]) == 1


def test_an_empty_world_clears_what_was_shown(make: Make) -> None:
    array = world_markers({"frame_id": "", "nodes": []}, make)
    assert [m.action for m in array.markers] == [DELETE_ALL]


def test_the_display_asks_only_while_heard_and_publishes_only_what_changed(
    scene: dict[str, Any], make: Make
) -> None:
    asked, shown, heard = [], [], [False]

    def ask() -> dict[str, Any]:
        asked.append(threading.current_thread())
        return scene

    display = WorldDisplay(ask, shown.append, lambda: heard[0], make)

    def refresh() -> None:
        display.refresh()
        display.wait(60.0)

    refresh()
    assert not asked
    heard[0] = True
    refresh()
    refresh()
    assert (len(asked), len(shown)) == (2, 1)
    assert threading.current_thread() not in asked, "a slow server must not hold the node"
    scene["nodes"][-1]["still_there"] -= 0.001
    refresh()
    assert len(shown) == 1
    scene["nodes"][-1]["still_there"] = 0.3
    refresh()
    assert len(shown) == 2


def test_a_server_that_does_not_answer_leaves_what_is_shown(
    scene: dict[str, Any], make: Make, caplog: pytest.LogCaptureFixture
) -> None:
    shown: list[Any] = []

    def ask() -> dict[str, Any]:
        if shown:
            raise RemoteUnavailableError("nobody answers")
        return scene

    display = WorldDisplay(ask, shown.append, lambda: True, make)
    for _ in range(2):
        display.refresh()
        display.wait(60.0)
    assert len(shown) == 1
    assert "stays as it was" in caplog.text
