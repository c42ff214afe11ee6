"""What a robot moves beside the thing of its step: seen, and no longer said to be where it was."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.arms.bench import Bench
from simulate.tasks.arms.bystanders import Bystanders
from simulate.tasks.arms.introducing import introduce, survey
from simulate.tasks.arms.layouts import own_table
from simulate.tasks.executor import Executor
from simulate.tasks.lab import LabRobot, read_lab
from simulate.world.objects import spec_of
from simulate.world.scene import Placement
from tests.rtask.tasks.conftest import BASE, JUG, LAB, PANDA, PEN, RIGHT, TABLE

pytestmark = pytest.mark.slow

_BESIDE, _GONE = (0.41, 0.06), (0.45, 3.0)
"""In the left half, beside what stands there, and off the table; m."""


def place_of(graph, thing: str) -> str:
    rows = graph.query(f"{PREFIXES} SELECT ?at WHERE {{ <{thing}> rt:locatedOn ?at }}")
    return str(rows[0]["at"]) if rows else ""


def test_what_stood_beside_a_motion_is_looked_for_after_it(tmp_path, monkeypatch):
    layout = own_table("panda-1", "panda")
    spots = {name: (sum(layout.area(name).x) / 2, sum(layout.area(name).y) / 2)
             for name in ("left half", "right half")}  # fmt: skip
    specs = {"left half": spec_of("can-81"), "right half": spec_of("can-86")}
    bench = Bench(
        layout, [Placement(specs[name], *at, 0.3) for name, at in spots.items()], tmp_path,
        preset="fast",
    )  # fmt: skip
    try:
        with rtask.open(":memory:") as kb, Engine(kb) as engine:
            planner = rtask.connect(engine)
            crew = introduce(planner, bench)
            survey(planner, bench, crew)
            [body] = crew.bodies.values()
            at = {name: place for place, name in crew.places.items()}
            where = {place_of(planner, thing): thing for thing in body._bystanders._whereabouts()}
            taken, other = where[at["left half"]], where[at["right half"]]
            [body_of_other] = [laid.body for laid in bench.laid
                               if bench.area_of(laid.body) == "right half"]  # fmt: skip

            body._bystanders.note(taken)
            body._products[taken] = body.product(other)  # as if they were two of one product
            assert not body._lies_elsewhere(taken, at["left box"]), (
                "its equal stands where it stood"
            )
            del body._products[taken]
            bench.put(body_of_other, spots["right half"][0] - 0.03, spots["right half"][1])
            assert body.displaced() == {}, "moved within its area"
            body._bystanders.note(taken)
            bench.put(body_of_other, *_BESIDE)
            assert body.displaced() == {other: at["left half"]}
            assert not body._lies_elsewhere(other, at["left half"])
            assert body._lies_elsewhere(other, at["left box"]), "it did not get to the box"

            planner.call("state_place", thing=other, place=at["left half"])
            body._bystanders.note(taken)
            bench.put(body_of_other, *_GONE)
            planner.call("state_place", thing=other, place=at["right box"])
            assert body.displaced() == {}, "another robot has taken it meanwhile"
            bench.put(body_of_other, *spots["right half"])
            planner.call("state_place", thing=other, place=at["right half"])
            with monkeypatch.context() as hidden:
                sight, views = body._sight, body.robot.viewpoints
                hidden.setattr(body.robot, "viewpoints", lambda area: views(area)[:1] * 2)
                hidden.setattr(body, "_sight", lambda item, place, number=0: (
                    sight(item, place) if number else None
                ))  # fmt: skip
                assert body.find(other) == at["right half"], "seen from another side alone"
                assert body.sees(other, at["right half"]), "or the same plan would be made for ever"
            body._bystanders.note(taken)
            bench.put(body_of_other, *_GONE)
            assert body.displaced() == {other: None}
    finally:
        bench.close()


class Eyes:
    """Eyes that tell products apart, not things: each area has so many of a product."""

    def __init__(self, where: dict[str, list[str]]) -> None:
        self.where, self.held, self.hidden = where, "", 0
        self.is_replaced = False

    def product(self, item: str) -> str:
        return item.rstrip("0123456789")

    def holds(self, item: str) -> bool:
        return item == self.held

    def count_seen(self, item: str, place: str) -> int:
        return self.where.get(place, []).count(self.product(item))

    def is_seen(self, item: str, place: str) -> bool:
        return self.count_seen(item, place) > 0

    def spots(self, item: str, place: str) -> list[int]:
        return list(range(self.count_seen(item, place)))

    def is_empty(self, spot: int, place: str) -> bool:
        """The first are those that stand there still, the last those that an arm hides."""
        there = 0 if self.is_replaced else len(self.where.get(place, []))
        return there <= spot < 3 - self.hidden

    def place_seen(self, item: str) -> str | None:
        return next((place for place in self.where if self.is_seen(item, place)), None)


class KnownPlaces:
    """A graph that says where things are."""

    def __init__(self, **places: str) -> None:
        self.rows = [{"thing": thing, "place": place} for thing, place in places.items()]

    def query(self, sparql: str) -> list[dict[str, str]]:
        return self.rows


@pytest.mark.parametrize(
    ("after", "is_held", "moved"),
    [
        ({"here": ["can", "can"]}, True, {}),
        ({"here": ["can"]}, True, {"can3": None}),
        ({"here": ["can"], "there": ["can"]}, True, {"can3": "there"}),
        (
            {"here": ["can", "can"]},
            False,
            {"can3": None},
        ),  # can1 stayed: the graph has it here, too
        ({"here": ["can", "can", "can"]}, False, {}),
        ({"here": []}, True, {"can2": None, "can3": None}),
    ],
)
def test_of_equal_things_so_many_are_missed_as_are_no_longer_seen(after, is_held, moved):
    eyes = Eyes({"here": ["can"] * 3, "there": []})
    graph = KnownPlaces(can1="here", can2="here", can3="here")
    bystanders = Bystanders(eyes, graph, ["here", "there"])
    bystanders.note("can1")
    eyes.where, eyes.held = after, "can1" * is_held
    assert bystanders.displaced() == moved


def test_what_an_arm_hides_is_not_gone_and_is_looked_for_after_the_next_motion():
    eyes = Eyes({"here": ["can", "box"]})
    bystanders = Bystanders(eyes, KnownPlaces(can1="here", box1="here"), ["here"])
    bystanders.note("can1")
    eyes.where, eyes.held, eyes.hidden = {"here": []}, "can1", 3
    assert bystanders.displaced() == {}, "behind the can in the hand"
    assert bystanders.displaced() == {}, "a step that moved nothing"
    bystanders.note("can1", "there")
    eyes.held, eyes.hidden = "", 0
    assert bystanders.displaced() == {"box1": None}


def test_of_equal_things_no_more_are_missed_than_have_left_an_empty_spot():
    eyes = Eyes({"here": ["can"] * 3, "there": []})
    bystanders = Bystanders(eyes, KnownPlaces(can1="here", can2="here", can3="here"), ["here"])
    bystanders.note("can1")
    eyes.where, eyes.held, eyes.hidden = {"here": ["can"]}, "can1", 1
    assert bystanders.displaced() == {}


def test_equal_things_that_were_not_all_seen_before_are_not_missed():
    eyes = Eyes({"here": ["can"] * 2})
    bystanders = Bystanders(eyes, KnownPlaces(can1="here", can2="here", can3="here"), ["here"])
    bystanders.note("can1")
    eyes.where, eyes.held = {"here": ["can"]}, "can1"
    assert bystanders.displaced() == {}


def test_a_thing_put_beside_its_equal_does_not_stand_for_it():
    eyes = Eyes({"here": ["can"], "there": []})
    bystanders = Bystanders(eyes, KnownPlaces(can1="hand", can2="here"), ["here", "there"])
    bystanders.note("can1", "here")
    eyes.where, eyes.is_replaced = {"here": ["can"]}, True
    assert bystanders.displaced() == {"can2": None}, "it pushed its equal away, and stands there"


class Clumsy:
    """A robot that pushes something else aside, or off the table, when it picks a thing up."""

    def __init__(self, body: LabRobot, pushed: str, to: str | None) -> None:
        self._body, self._pushed, self._to = body, pushed, to

    def __getattr__(self, name: str) -> object:
        return getattr(self._body, name)

    def displaced(self) -> Mapping[str, str | None]:
        return {self._pushed: self._to}


@pytest.mark.parametrize("to", [RIGHT, None])
def test_the_graph_hears_of_a_thing_that_was_pushed_away(to: str | None):
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(LAB)
        graph = rtask.connect(engine)
        graph.call("store_plan", goal="every pen into the right box")
        lab = read_lab(graph.query, None)
        assert place_of(graph, JUG) == TABLE
        robot = Executor(graph, Clumsy(lab.robot(PANDA), JUG, to), PANDA)
        lab.rng = type("Never", (), {"random": staticmethod(lambda: 1.0)})
        assert robot.turn().result == "done"
        assert place_of(graph, JUG) == (to or ""), "not known since, or where it is seen"
        assert place_of(graph, PEN) == f"{PANDA}/hand"
