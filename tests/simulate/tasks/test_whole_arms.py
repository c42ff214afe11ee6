"""Whole arms at a bench: where robots see things, what they know of hands, and whole goals."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.grasping.rules import GraspRequest
from simulate.motion.collision import Obstacle
from simulate.tasks.arms.bench import Bench
from simulate.tasks.arms.introducing import _store, introduce, survey
from simulate.tasks.arms.layouts import own_table, place_things, sorting_table
from simulate.tasks.arms.station_body import RobotAtBench
from simulate.tasks.arms.working import Settings, WholeCrew, crew_at_tables
from simulate.world.objects import sample_objects, spec_of
from simulate.world.scene import Placement

pytestmark = pytest.mark.slow

PRODUCT = "urn:product"
_APART_M = 0.025
"""By which the middle of what is seen may be off: cameras see one side of a thing."""


def _free(layout, spec, area):
    """Return a placement in the middle of an area, frame of the bench."""
    at = layout.area(area)
    return Placement(spec, sum(at.x) / 2, sum(at.y) / 2, 0.3)


def test_robots_of_both_sides_see_a_thing_at_one_place(tmp_path):
    """A Nao and the Panda opposite look at the part of the table that they share."""
    layout = sorting_table()
    bench = Bench(layout, [_free(layout, spec_of("can-81"), "left part")], tmp_path, preset="fast")
    try:
        pose = bench.world.object_pose(bench.laid[0].body)
        assert bench.area_of(bench.laid[0].body) == "left part"
        for robot in ("nao-1", "panda-1"):
            station = bench.stations[robot]
            _, [seen] = RobotAtBench(station).look_at("left part")
            world = station.world_from_base @ [*seen.position, 0.0, 1.0]
            assert np.hypot(*(world[:2] - [pose.x, pose.y])) < _APART_M
            known = bench.product_at(station, seen.position)
            assert known is not None
            assert known.name == "can-81"
        _, elsewhere = RobotAtBench(bench.stations["nao-2"]).look_at("right part")
        assert elsewhere == []
        bench.put(bench.laid[0].body, 0.15, -0.40)
        robot = RobotAtBench(bench.stations["nao-2"])
        view, [seen] = robot.look_at("right part")
        assert seen.position[1] == pytest.approx(0.10, abs=_APART_M)
        spots = np.array(robot.free_spots("right part", 0.03, view.perceived))
        assert np.linalg.norm(seen.points[None, :, :2] - spots[:, None], axis=2).min() > 0.015
        assert robot.free_spots("right part", 0.5, view.perceived) == ()
        # Where its arm does not get to, a camera of the Panda sees what lies in a box.
        panda = RobotAtBench(bench.stations["panda-1"])
        assert panda.shows("left box")
        assert not robot.shows("left box")
        bench.put(bench.laid[0].body, 0.15, 0.21)
        assert bench.area_of(bench.laid[0].body) == "left box"
        _, inside = panda.look_at("left box")  # the can, and what is seen of the walls
        seen_at = [(panda.station.world_from_base @ [*s.position, 0.0, 1.0])[:2] for s in inside]
        assert min(np.hypot(*(at - [0.15, 0.21])) for at in seen_at) < _APART_M
    finally:
        bench.close()


def test_a_spot_for_the_next_robot_is_one_where_its_hand_gets_around_the_thing(tmp_path):
    """Farther from the Nao than its arm is long, there is no way; and none is asked for alone."""
    bench = Bench(sorting_table(), [], tmp_path, preset="fast")
    try:
        panda = RobotAtBench(bench.stations["panda-1"])
        request = GraspRequest(0.0, 0.0, 0.0, width=0.033, height=0.08, length=0.033, round=True)
        nao = bench.stations["nao-1"]
        (x0, x1), (y0, y1) = panda.station.ranges("left part")
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        assert panda.ways("left part", middle, request)
        height = request.table_height + 0.05
        beside = [Obstacle.box("neighbour", (middle[0], middle[1] + way, height), (0.1, 0.02, 0.1))
                  for way in (-0.035, 0.035)]  # fmt: skip
        assert panda.ways("left part", middle, request, beside) == (), "no hand fits in between"
        far = nao.world_from_base @ [0.45, -0.1, 0.0, 1.0]
        assert not nao.gets_to("right_arm", far, request, 0.0)
        assert panda.ways("middle", middle, request) == ()
    finally:
        bench.close()


def test_things_stand_in_areas_that_hands_get_to():
    layout = sorting_table()
    specs = sample_objects(np.random.default_rng(3), 6, ("can", "box"))
    placed = place_things(layout, specs, np.random.default_rng(3))
    assert sorted(spot.spec.name for spot in placed) == sorted(spec.name for spec in specs)
    inside = [[a.name for a in layout.areas if a.holds(spot.x, spot.y)] for spot in placed]
    assert all(len(names) == 1 and "box" not in names[0] for names in inside)


def test_what_lies_just_beyond_an_area_belongs_to_it_and_what_fell_off_the_table_to_none(tmp_path):
    layout = sorting_table()
    at = {"within": (0.15, 0.40), "beyond": (0.119, 0.435), "between": (0.26, 0.38),
          "in the box": (0.15, 0.20), "far": (0.30, 0.80), "off": (0.40, 0.38)}  # fmt: skip
    assert {name: layout.area_at(*spot) for name, spot in at.items()} == {
        "within": "left part", "beyond": "left part", "between": "left part",
        "in the box": "left box", "far": "", "off": "",
    }  # fmt: skip
    bench = Bench(layout, [_free(layout, spec_of("can-81"), "left part")], tmp_path, preset="fast")
    try:
        [laid] = bench.laid
        bench.put(laid.body, *at["beyond"])
        _, [seen] = RobotAtBench(bench.stations["nao-1"]).look_at("left part")
        assert seen.position.shape == (2,)
        assert bench.area_of(laid.body) == "left part"
        bench.world.put(laid.body, (0.15, 0.40, 0.02), (0.0, 0.0, 0.0, 1.0))
        assert bench.area_of(laid.body) == "", "on the floor below it"
    finally:
        bench.close()


@pytest.mark.parametrize(
    ("is_sure", "there", "taken", "named", "stored"),
    [
        (True, [], (), [], (PRODUCT, None, None)),
        (True, ["urn:1"], (), [], (PRODUCT, "urn:1", None)),
        (True, ["urn:1"], ("urn:1",), [], (PRODUCT, None, None)),  # its equal beside it
        (False, ["urn:1"], (), [], (PRODUCT, "urn:1", None)),
        (False, ["urn:1"], ("urn:1",), [], (None, None, "can-86")),
        (False, [], (), [], (None, None, "can-86")),
        (False, [], (), ["urn:can-86"], ("urn:can-86", None, None)),
    ],
)
def test_a_survey_takes_what_resembles_a_product_for_one_only_where_such_a_thing_is_expected(
    is_sure, there, taken, named, stored
):
    entries: list[dict[str, str]] = []

    def call(operation, **fields):
        entries.extend(fields.get("objects", []))
        return {"objects": [{"thing": "urn:new", "object": "urn:object"}]}

    def query(text):
        key, values = ("thing", there) if "locatedOn" in text else ("product", named)
        return [{key: value} for value in values]

    seen = SimpleNamespace(position=np.zeros(2))
    sighting = SimpleNamespace(seen=seen, object=PRODUCT, observation={}, is_accepted=is_sure)
    graph = SimpleNamespace(call=call, query=query, update=lambda text: None)
    body = SimpleNamespace(robot=SimpleNamespace(station=None), hands={"hand": ""}, graph=graph)
    bench = SimpleNamespace(product_at=lambda station, at: spec_of("can-86"))
    _store(graph, bench, body, sighting, "urn:place", taken)
    [entry] = entries
    assert tuple(entry.get(name) for name in ("object", "thing", "name")) == stored


def test_a_survey_tells_the_graph_what_stands_where_and_hands_where_they_get_to(tmp_path):
    layout = own_table("nao-1", "nao")
    bench = Bench(layout, [_free(layout, spec_of("can-81"), "right half")], tmp_path, preset="fast")
    try:
        with rtask.open(":memory:") as kb, Engine(kb) as engine:
            planner = rtask.connect(engine)
            crew = introduce(planner, bench)
            [thing] = survey(planner, bench, crew)
            [body] = crew.bodies.values()
            places = {name: place for place, name in crew.places.items()}
            assert body.find(thing) == places["right half"]
            assert not body.sees(thing, places["left half"])
            plan = kb.tasks.plan("every can into the right box")
            assert plan.is_complete
            arm = {body._arms[step.arguments["hand"]] for step in plan.steps}
            assert arm == {"right_arm"}
            # A hand without anything in it puts nothing down.
            [hand, *_] = body.hands
            deed = body.put(thing, places["right box"], hand)
            assert (deed.success, deed.reason) == (False, "slip_transport")
    finally:
        bench.close()


def test_the_command_prints_as_json_what_a_person_declined(tmp_path, capsys):
    """No arm moves, so this is cheap; see below for whole goals."""
    data = ["-d", str(tmp_path / "kb"), "--preset", "fast", "--json"]
    words = ["everything into the left box", "--table", "panda", "--things", "1"]
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "crew", *words, "--decline", "picks", *data])
    assert ended.value.code == 0
    printed = json.loads(capsys.readouterr().out)
    [goal] = printed["goals"]
    assert (goal["goal"], goal["result"]) == ("everything into the left box", "declined")
    assert [turn["result"] for turn in printed["turns"]] == ["declined"]
    [thing] = printed["things"]
    assert thing["remembered"] == thing["truly"] != "left box"


@pytest.mark.deep
def test_what_a_person_took_away_is_lost_at_the_next_survey(tmp_path):
    layout = own_table("panda-1", "panda")
    bench = Bench(layout, [_free(layout, spec_of("can-81"), "right half")], tmp_path, preset="fast")
    try:
        with rtask.open(":memory:") as kb, Engine(kb) as engine:
            planner = rtask.connect(engine)
            crew = introduce(planner, bench)
            [thing] = survey(planner, bench, crew)
            bench.put(bench.laid[0].body, 0.45, 2.0)
            assert survey(planner, bench, crew) == []
            assert not kb.query(f"{PREFIXES} ASK {{ <{thing}> rt:locatedOn ?place }}")
            bench.put(bench.laid[0].body, 0.45, 0.10)
            [again] = survey(planner, bench, crew)
            assert kb.query(f"{PREFIXES} ASK {{ <{again}> rt:locatedOn/rt:name 'left half' }}")
    finally:
        bench.close()


@pytest.mark.deep
def test_a_panda_reaches_a_goal_and_the_physics_agrees():
    with rtask.open(":memory:") as kb, Engine(kb) as engine:
        planner = rtask.connect(engine)
        with crew_at_tables(planner, Settings(("panda",), 2, seed=4)) as working:
            planner.call("store_plan", goal="something into the left box")
            [ended] = working.work()
            assert ended.result == "reached"
            where = [truth.place for truth in working.truths()]
            assert where.count("left box") == 1
            assert all(t.remembered in ("", t.place) for t in working.truths())
        linked = kb.select(f"""{PREFIXES} SELECT ?attempt WHERE {{
          ?step rt:stepNumber ?number ; rt:handlesExemplar ?thing ; rt:carriedOutBy ?attempt .
          ?attempt a rt:GraspAttempt ; rt:handlesExemplar ?thing ; rt:executesGrasp ?grasp ;
            rt:hasOutcome/rt:success true }}""")
        assert len({str(row.value("attempt")) for row in linked}) == 1


@pytest.mark.deep
def test_a_thing_changes_hands_between_a_panda_and_a_nao(tmp_path):
    layout = sorting_table()
    bench = Bench(layout, [_free(layout, spec_of("can-81"), "right part")], tmp_path)
    try:
        with rtask.open(":memory:") as kb, Engine(kb) as engine:
            planner = rtask.connect(engine)
            crew = introduce(planner, bench)
            working = WholeCrew(planner, [bench], [crew], survey(planner, bench, crew))
            planner.call("store_plan", goal="every can into the left box")
            done = []
            working.work(lambda robot, turn: done.append((robot.rpartition("/")[2], turn.result)))
            assert {"panda-1", "nao-1"} <= {robot for robot, result in done if result == "done"}
            assert [(t.remembered, t.place) for t in working.truths()] == [("left box", "left box")]
    finally:
        bench.close()
