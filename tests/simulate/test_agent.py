"""The robot's mind, with a table, a hand and a server that behave as told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from features.geometry import Frame
from features.perception import Perceived
from simulate.agent import second_look
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.decisions import Refusal, Thresholds
from simulate.agent.encounter import Attempt, Encounter
from simulate.agent.messages import outcome_message, pose_message
from simulate.grasping.judgement import Judgement
from tests.simulate.agent_doubles import CAMERA, Plan, Record, seen_at


@dataclass
class _Body:
    """A table on which a placed object is gone and a missed one stays."""

    table: list[tuple[float, float]]
    outcomes: list[Record] = field(default_factory=list)
    unreachable: bool = False
    blocked: dict[tuple[float, float], int] = field(default_factory=dict)
    planned: list[Any] = field(default_factory=list)
    executed: list[Any] = field(default_factory=list)
    doubted: tuple[float, ...] = ()
    only_leaning: tuple[float, ...] = ()
    base_frame = "base_footprint"
    ignored = ()
    preset = "faithful"
    takes_poses = False

    def __post_init__(self) -> None:
        self.pushed: list[Any] = []

    def push(self, points, others, height, side, seed):
        self.pushed.append((points, others))
        return "ok"

    @property
    def gripper_ids(self) -> dict[str, str]:
        return {"right": "right_hand", "left": "left_hand"}

    def look(self, side: str) -> tuple[Frame, np.ndarray]:
        return Frame(np.zeros((12, 16), np.float32), CAMERA), np.eye(4)

    def plan(self, request, obstacles, seed):
        if self.unreachable or len(self.table) > self.blocked.get((request.x, request.y), 99):
            return "ik"
        if request.theta in self.only_leaning and request.stances == "own":
            return "ik"
        self.planned.append(request)
        return Plan(request, is_doubtful=request.theta in self.doubted)

    def execute(self, plan):
        record = self.outcomes.pop(0) if self.outcomes else Record()
        self.executed.append(plan.request)
        if record.placed:
            self.table.remove((plan.request.x, plan.request.y))
        return record, [("held", b"png")]


class _Server:
    """Knows nothing, or everything; keeps what it was told."""

    def __init__(self, knows: float = 0.0, angles: tuple[float, ...] = (0.0,)) -> None:
        self.confidence = knows
        self.angles = angles
        self.asked: list[dict] = []
        self.inserted: list[dict] = []
        self.reported: list[dict] = []
        self.responses: list[tuple[str, str]] = []

    def recognise_for_grasp(self, **request):
        self.asked.append(request)
        known = self.confidence >= 0.7
        x, y = TABLE_OF[len(self.asked) - 1] if TABLE_OF else (0.0, 0.0)
        grasp = {
            "id": "g:1" if known else "candidate:0",
            "source": "memory" if known else "candidate",
            "x": x,
            "y": y,
            "z": 0.3,
            "theta": 0.0,
            "width": 0.03,
            "opening": 0.05,
            "mean": 0.9,
        }
        return {
            "task_id": f"t:{len(self.asked)}",
            "object": "o:7" if known else "",
            "label": "can 7" if known else "",
            "recognition": {
                "accepted": known,
                "matches": [{"confidence": self.confidence}] if self.confidence else [],
            },
            "grasps": [{**grasp, "theta": angle} for angle in self.angles],
            "times": {"total_s": 0.01},
        }

    def insert_object(self, objects):
        self.inserted.append(objects[0])
        return {"objects": [{"object": objects[0].get("object", f"o:{len(self.inserted)}")}]}

    def report_outcome(self, **report):
        self.reported.append(report)
        return {"stored": 1}

    def report_refusal(self, refusal, response):
        self.responses.append((refusal, response))
        return {"stored": 1}


def _too_low(lacking: str, confidence: float, threshold: float) -> dict[str, Any]:
    return {
        "answer": "too_low", "too_low": lacking, "confidence": confidence,
        "threshold": threshold, "refusal": f"r:{lacking}",
    }  # fmt: skip


class _Doubting(_Server):
    """Refuses whatever a request asks for by name, and grants what it does not."""

    def __init__(self, lacking: str, **more: Any) -> None:
        super().__init__(**more)
        self.lacking = lacking

    def recognise_for_grasp(self, **request):
        answer = super().recognise_for_grasp(**request)
        if request[f"min_{self.lacking}"] > 0:
            answer |= {"decision": _too_low(self.lacking, 0.05, 0.1), "grasps": []}
        return answer


TABLE_OF: list[tuple[float, float]] = []


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch):
    """Run an agent over a table and return (agent, encounters)."""

    def _run(
        body: _Body, server: _Server, order: list[tuple[float, float]],
        on_event=lambda name, data: None, see=None, **config
    ):  # fmt: skip
        TABLE_OF[:] = order

        def everything(*_: Any) -> Perceived:
            return Perceived("ok", 0.27, tuple(seen_at(x, y) for x, y in body.table))

        monkeypatch.setattr(second_look, "perceive", see or everything)
        agent = Agent(body, server, AgentConfig(**config), on_event)
        return agent.clear_table()

    return _run


def test_the_outermost_object_comes_first_and_each_side_has_its_hand(run) -> None:
    table = [(0.15, -0.05), (0.15, -0.16), (0.14, 0.10)]
    server = _Server()
    run(_Body(list(table)), server, [table[1], table[0], table[2]])
    assert [r["gripper_id"] for r in server.asked] == ["right_hand", "right_hand", "left_hand"]


def test_what_was_moved_to_the_side_that_was_done_is_taken_too(run) -> None:
    table = [(0.15, -0.10), (0.15, 0.18), (0.15, 0.08)]

    class Sweeping(_Body):
        def execute(self, plan):
            done = super().execute(plan)
            if plan.request.y == table[1][1]:
                self.table[:] = [(0.15, -0.03)]
            return done

    body = Sweeping(list(table))
    run(body, _Server(), [table[0], table[1], (0.15, -0.03)])
    assert [request.y for request in body.executed] == [-0.10, 0.18, -0.03]


def test_what_was_hidden_by_a_placed_object_is_another_one(run) -> None:
    spot, beside = (0.15, -0.10), (0.15, -0.06)

    class Hiding(_Body):
        def execute(self, plan):
            done = super().execute(plan)
            if plan.request.y == spot[1]:
                self.table[:] = [beside]
            return done

    body = Hiding([spot])
    first, second = run(body, _Server(), [spot, beside])
    assert (first.number, second.number) == (1, 2)
    assert first.placed
    assert second.placed


def test_an_object_nobody_knows_is_stored_with_its_view_grasp_and_outcome(run) -> None:
    spot = (0.15, -0.1)
    server = _Server()
    (met,) = run(_Body([spot]), server, [spot])
    (stored,) = server.inserted
    assert stored["grasp"]["id"] == "candidate:0"
    assert stored["outcome"]["success"] is True
    assert stored["outcome"]["images"][0]["phase"] == "held"
    assert stored["data"]
    assert "object" not in stored
    assert (met.object_iri, met.recognised, met.tries_to_success) == ("o:1", "", 1)


def test_a_well_known_object_is_only_reported_on(run) -> None:
    spot = (0.15, -0.1)
    server = _Server(knows=0.95)
    (met,) = run(_Body([spot]), server, [spot])
    assert not server.inserted
    assert server.reported[0]["object"] == "o:7"
    assert server.reported[0]["task_id"] == "t:1"
    assert (met.recognised, met.attempts[0].source) == ("o:7", "memory")


def test_a_grasp_planned_on_the_view_is_reported_with_the_view(run) -> None:
    table = [(0.15, -0.16), (0.16, -0.16)]
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = *table[1], 0.3

    class Planning(_Server):
        def plan_on_scene(self, **request):
            segments = [{"segment": 4, "centre": [*table[1], 0.3]}]
            grasp = {
                "id": "candidate:scene-1", "kind": "spatial", "segment": 4, "confidence": 0.95,
                "tool_pose": {"pose": pose_message(pose)}, "width": 0.03, "opening": 0.05,
                "x": table[1][0], "y": table[1][1], "theta": 0.0,
            }  # fmt: skip
            return {"segments": segments, "grasps": [grasp]}

    class Posing(_Body):
        takes_poses = True

        def plan(self, request, obstacles, seed):
            assert request.pose is None or len(obstacles) == len(self.table) - 1
            return super().plan(request, obstacles, seed)

    body, server = Posing(list(table)), Planning(knows=0.95)
    run(body, server, [table[1], table[0]])
    first, second = body.executed
    assert np.array_equal(first.pose, pose)
    assert second.pose is None  # it stood alone by then
    (stored,) = server.inserted
    assert (stored["object"], stored["grasp"]["source"]) == ("o:7", "scene")
    assert [report["grasp"]["source"] for report in server.reported] == ["memory"]


def test_an_object_known_but_not_well_gives_one_more_view(run) -> None:
    spot = (0.15, -0.1)
    server = _Server(knows=0.75)
    run(_Body([spot]), server, [spot])
    assert server.inserted[0]["object"] == "o:7"


def test_what_it_is_not_sure_of_the_robot_sees_from_another_place_before_it_asks_again(
    run,
) -> None:
    looked: list[str] = []

    class Turning(_Body):
        def look(self, side):
            looked.append(side)
            pose = np.eye(4)
            pose[1, 3] = {"right": -0.03, "ahead": 0.0, "left": 0.03}[side]
            return super().look(side)[0], pose

    class Unsure(_Server):
        def recognise_for_grasp(self, **request):
            self.confidence = 0.95 if "looks" in request else 0.6
            answer = super().recognise_for_grasp(**request)
            if request["unknown"] == "if_new" and not answer["recognition"]["accepted"]:
                answer["decision"] = _too_low("identity", 0.6, 0.7)
            return answer

    body, server = Turning([(0.16, -0.1)]), Unsure()

    def see(*_: Any) -> Perceived:
        more = [(0.16, 0.02)] if looked[-1] == "ahead" else []
        return Perceived("ok", 0.27, tuple(seen_at(x, y) for x, y in [*body.table, *more]))

    (encounter,) = run(body, server, [(0.16, -0.1)] * 2, see=see)
    assert encounter.recognised == "o:7"
    assert len(server.asked) == 2
    first, again = server.asked
    (look,) = again["looks"]
    assert look["sensor_pose"]["position"]["y"] == 0.0
    assert again["data"] == first["data"]
    assert looked[looked.index("ahead") + 1] == "right"  # the head is back

    assert encounter.refusals == [Refusal("identity", 0.6, 0.7, "second_look", "r:identity")]

    fixed = Unsure()
    (encounter,) = run(_Body([(0.16, -0.1)]), fixed, [(0.16, -0.1)] * 2)
    assert all("looks" not in asked for asked in fixed.asked)
    assert fixed.responses == [("r:identity", "new_object")]
    assert encounter.placed


def test_a_doubtful_pose_is_done_without(run) -> None:
    spot = (0.15, -0.1)
    server = _Doubting("pose", knows=0.95)
    (met,) = run(_Body([spot]), server, [spot] * 2, thresholds=Thresholds(pose=0.7))
    assert [asked["min_pose"] for asked in server.asked] == [0.7, 0.0]
    assert server.responses == [("r:pose", "measured_sides")]
    assert met.placed


def test_what_no_grasp_is_likely_to_hold_waits_for_others_and_is_then_left_alone(run) -> None:
    outer, inner = (0.15, -0.16), (0.15, -0.05)

    class Fearing(_Doubting):
        def recognise_for_grasp(self, **request):
            known = TABLE_OF[len(self.asked)]
            answer = super().recognise_for_grasp(**request)
            return answer if known == outer else {**answer, "decision": None, "grasps": _at(inner)}

    def _at(spot):
        return [{"id": "g", "source": "candidate", "x": spot[0], "y": spot[1], "z": 0.3,
                 "theta": 0.0, "width": 0.03, "opening": 0.05, "mean": 0.9}]  # fmt: skip

    body, server = _Body([outer, inner]), Fearing("grasp")
    first, second = run(body, server, [outer, inner, outer])
    assert server.responses == [("r:grasp", "postponed"), ("r:grasp", "left_alone")]
    assert [(a.reason, a.physical) for a in first.attempts] == [("refused", False)]
    assert second.placed
    assert len(body.executed) == 1
    assert all(asked["decide"] and asked["min_grasp"] == 0.1 for asked in server.asked)


class _Strong(_Body):
    """Its pushes part what touches."""

    takes_poses = True

    def push(self, points, others, height, side, seed):
        spot = tuple(np.round(points[0, :2], 3).tolist())
        self.table[self.table.index(spot)] = (spot[0], spot[1] - 0.05)
        return super().push(points, others, height, side, seed)


class _Crowded(_Server):
    """Plans nothing on a view; its grasps are those of the thing that is asked about."""

    def __init__(self, body: _Body) -> None:
        super().__init__()
        self.body = body

    def plan_on_scene(self, **request):
        return {"segments": [], "grasps": []}

    def recognise_for_grasp(self, **request):
        around = {tuple(point[:2]) for point in request["neighbours"]}
        TABLE_OF[:] = [spot for spot in self.body.table if spot not in around] * 99
        return super().recognise_for_grasp(**request)


def test_what_touches_others_and_cannot_be_grasped_is_pushed(run) -> None:
    spots = [(0.15, -0.10), (0.16, -0.10)]
    events: list[str] = []

    class Stuck(_Strong):
        def plan(self, request, obstacles, seed):
            return super().plan(request, obstacles, seed) if self.pushed else "ik"

    body = Stuck(list(spots))
    met = run(body, _Crowded(body), [], on_event=lambda name, _: events.append(name))
    ((points, (other,)),) = body.pushed
    assert {tuple(points[0, :2]), tuple(other[0, :2])} == set(spots)
    assert events.count("push") == 1
    assert all(one.placed for one in met)


def test_what_stands_free_is_not_pushed(run) -> None:
    body = _Strong([(0.15, -0.1)], unreachable=True)
    (met,) = run(body, _Crowded(body), [])
    assert body.pushed == []
    assert met.attempts[0].reason == "ik"


def test_a_thing_that_was_missed_three_times_in_a_crowd_is_pushed_and_tried_once_more(run) -> None:
    miss = Record("missed", held=False, placed=False)
    body = _Strong([(0.15, -0.16), (0.16, -0.16)], [miss] * 3)
    met = run(body, _Crowded(body), [], max_attempts=4)
    assert sorted(tuple(a.reason for a in one.attempts) for one in met) == [
        ("missed", "missed", "missed", "ok"), ("ok",)
    ]  # fmt: skip
    assert len(body.pushed) == 1


def test_after_a_miss_the_robot_tries_again_and_says_which_object_it_is(run) -> None:
    spot = (0.15, -0.1)
    miss = Record("missed", held=False, placed=False)
    server = _Server()
    (met,) = run(_Body([spot], [miss, miss]), server, [spot] * 3)
    assert "object" not in server.asked[0]
    assert server.asked[1]["object"] == server.asked[2]["object"] == "o:1"
    assert [a.reason for a in met.attempts] == ["missed", "missed", "ok"]
    assert met.tries_to_success == 3
    assert [r["outcome"]["attempt_number"] for r in server.inserted] == [1, 2, 3]


def test_an_attempt_in_a_world_that_broke_down_is_not_told(run) -> None:
    spot = (0.15, -0.1)
    broken, server = Record("not_judged", held=False, placed=False), _Server()
    (met,) = run(_Body([spot], [broken]), server, [spot] * 2)
    assert [a.reason for a in met.attempts] == ["not_judged", "ok"]
    assert [r["outcome"]["reason"] for r in server.inserted] == ["ok"]


def test_the_robot_gives_up_after_its_last_attempt(run) -> None:
    spot = (0.15, -0.1)
    miss = Record("missed", held=False, placed=False)
    (met,) = run(_Body([spot], [miss] * 9), _Server(), [spot] * 9, max_attempts=3)
    assert met.tries == 3
    assert met.tries_to_success is None
    assert not met.held


def test_an_object_out_of_reach_is_recorded_with_its_reason_and_not_touched(run) -> None:
    spot = (0.15, -0.1)
    body, server = _Body([spot], unreachable=True), _Server()
    (met,) = run(body, server, [spot])
    assert not body.planned
    assert server.inserted[0]["outcome"] == {
        "success": False, "placed": False, "reason": "ik", "attempt_number": 1,
    }  # fmt: skip
    assert (met.tries, met.attempts[0].reason, met.attempts[0].physical) == (0, "ik", False)


def test_an_object_behind_others_waits_until_they_are_gone(run) -> None:
    outer, inner = (0.15, -0.16), (0.15, -0.05)
    body, server = _Body([outer, inner], blocked={outer: 1}), _Server()
    first, second = run(body, server, [outer, inner, outer])
    assert [(m.position, m.placed) for m in (first, second)] == [(outer, True), (inner, True)]
    assert [a.reason for a in first.attempts] == ["ok"]
    assert len(server.inserted) == 2


def test_an_object_that_turns_up_elsewhere_goes_on_where_it_was_left(run) -> None:
    """It vanishes for a look, and is recognised where nobody put it."""
    spot, other, far = (0.15, -0.16), (0.15, -0.05), (0.30, -0.10)
    body = _Body([spot, other], [Record("missed", held=False, placed=False)])
    server = _Server(knows=0.95)
    execute = body.execute

    def knocks_away(plan):
        result = execute(plan)
        if (plan.request.x, plan.request.y) == spot:
            body.table.remove(spot)
        elif (plan.request.x, plan.request.y) == other:
            body.table.append(far)
        return result

    body.execute = knocks_away
    asked = server.recognise_for_grasp

    def names(**request):
        answer = asked(**request)
        answer["object"] = "o:8" if len(server.asked) == 2 else "o:7"
        return answer

    server.recognise_for_grasp = names
    first, second = run(body, server, [spot, other, far])
    assert [a.reason for a in first.attempts] == ["missed", "ok"]
    assert first.tries_to_success == 2
    assert second.tries_to_success == 1


def _away(body: _Body, to: tuple[float, float] | None) -> None:
    """Let the first attempt miss and the object roll somewhere, or fall off the table."""
    execute = body.execute

    def rolls(plan):
        result = execute(plan)
        if len(body.executed) == 1:
            body.table.remove((plan.request.x, plan.request.y))
            body.table.extend([] if to is None else [to])
        return result

    body.execute = rolls


def test_what_rolled_to_a_side_that_was_clear_is_found_there_and_tried_again(run) -> None:
    spot, there = (0.15, 0.05), (0.16, -0.08)
    body, server = _Body([spot], [Record("missed", held=False, placed=False)]), _Server()
    _away(body, there)
    (met,) = run(body, server, [spot, there])
    assert [a.reason for a in met.attempts] == ["missed", "ok"]
    assert [r["gripper_id"] for r in server.asked] == ["left_hand", "right_hand"]
    assert "object" not in server.inserted[0]
    assert server.inserted[1]["object"] == "o:1"  # nobody knew it, and it is no second object
    assert not met.lost


def test_of_two_alike_that_are_missing_a_find_is_neither(run) -> None:
    spots, there = [(0.15, 0.15), (0.15, 0.05)], (0.16, -0.08)
    miss = Record("missed", held=False, placed=False)
    body = _Body(list(spots), [miss, miss])
    execute = body.execute

    def rolls(plan):
        result = execute(plan)
        if len(body.executed) <= 2:
            body.table.remove((plan.request.x, plan.request.y))
        if len(body.executed) == 2:
            body.table.append(there)
        return result

    body.execute = rolls
    first, second, third = run(body, _Server(), [*spots, there])
    assert (first.lost, second.lost, third.lost) == (True, True, False)
    assert third.placed


def test_what_is_nowhere_is_said_to_be_lost(run) -> None:
    spot, told = (0.15, -0.1), []
    body = _Body([spot], [Record("missed", held=False, placed=False)])
    _away(body, None)
    looks: list[str] = []
    look = body.look
    body.look = lambda side: looks.append(side) or look(side)
    (met,) = run(body, _Server(), [spot], on_event=lambda name, data: told.append((name, data)))
    assert met.lost
    assert ("missing", {"object": 1, "last_seen": [0.15, -0.1]}) in told
    assert looks[-2:] == ["right", "left"]
    assert looks.count("left") < 8  # it does not search for ever


def test_what_is_hidden_from_one_side_is_looked_for_from_another(run) -> None:
    spot, there = (0.15, -0.1), (0.15, -0.04)
    sees: list[str] = []

    class Turning(_Body):
        def look(self, side):
            sees.append(side)
            pose = np.eye(4)
            pose[1, 3] = {"right": -0.03, "ahead": 0.0, "left": 0.03}[side]
            return super().look(side)[0], pose

    body = Turning([spot], [Record("missed", held=False, placed=False)])
    _away(body, there)

    def perceived(*_: Any) -> Perceived:
        hidden = sees[-1] == "right" and bool(body.executed)
        table = () if hidden else tuple(seen_at(x, y) for x, y in body.table)
        return Perceived("ok", 0.27, table)

    server = _Server()
    (met,) = run(body, server, [spot, there], see=perceived)
    assert [a.reason for a in met.attempts] == ["missed", "ok"]
    assert sees[sees.index("ahead") + 1] == "right"  # the head is back
    assert server.asked[1]["sensor_pose"]["position"]["y"] == 0.0


def test_held_but_dropped_on_the_way_counts_as_held_and_is_tried_again(run) -> None:
    spot = (0.15, -0.1)
    dropped = replace(Record(), placed=False)
    (met,) = run(_Body([spot], [dropped]), _Server(), [spot] * 2)
    assert (met.tries_to_success, met.tries, met.placed) == (1, 2, True)


def test_the_same_seed_asks_with_the_same_seeds(run) -> None:
    spot = (0.15, -0.1)
    asked = []
    for _ in range(2):
        server = _Server()
        run(_Body([spot]), server, [spot], seed=5)
        asked.append(server.asked[0]["seed"])
    assert asked[0] == asked[1]
    assert 0 <= asked[0] < 2**31


def test_a_grasp_that_can_be_reached_well_goes_before_doubtful_ones(run) -> None:
    body = _Body([(0.15, -0.05)], doubted=(0.1, 0.2))
    server = _Server(angles=(0.1, 0.1, 0.2, 0.3, 0.4))
    [encounter] = run(body, server, [(0.15, -0.05)])
    assert [request.theta for request in body.planned] == [0.1, 0.2, 0.3]  # alike: planned once
    assert [request.theta for request in body.executed] == [0.3]
    assert encounter.attempts[0].held
    assert server.inserted[0]["grasp"]["rank"] == 4


def test_a_doubtful_grasp_is_better_than_none(run) -> None:
    body = _Body([(0.15, -0.05)], doubted=(0.1, 0.2))
    run(body, _Server(angles=(0.1, 0.2)), [(0.15, -0.05)])
    assert [request.theta for request in body.executed] == [0.1]


def test_it_leans_only_for_what_no_grasp_reaches_as_it_stands(run) -> None:
    spot = (0.15, -0.05)
    body = _Body([spot], only_leaning=(0.1,))
    run(body, _Server(angles=(0.1, 0.2)), [spot])
    assert [(r.theta, r.stances) for r in body.executed] == [(0.2, "own")]
    body = _Body([spot], only_leaning=(0.1, 0.2))
    run(body, _Server(angles=(0.1, 0.2)), [spot])
    assert [(r.theta, r.stances) for r in body.executed] == [(0.1, "other")]


def test_a_thing_that_was_lost_on_the_way_is_reported_as_a_failed_grasp() -> None:
    lost = Record(placed=False, judged_placed=Judgement("no"), place_reason="slip_transport")
    told = outcome_message(
        lost, 1, {"grasps": [{}], "times": {}}, {"rank": 1}, {"ask": 0.1, "plan": 0.1}, []
    )
    assert (told["success"], told["placed"], told["reason"]) == (False, False, "slip_transport")
    assert "motion" not in told
    encounter = Encounter(1, "right", (0.1, 0.1), (0.1, 0.03, 0.03))
    for number, reason in enumerate(("slip_transport", "ok"), start=1):
        encounter.attempts.append(
            Attempt(number, "candidate", "g", "ok", True, reason == "ok", True, 0.5, {},
                    place_reason=reason)
        )  # fmt: skip
    assert encounter.tries_to_success == 2
