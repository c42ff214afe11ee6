"""The order in which an agent clears a table, and what it leaves."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.messages import pose_message
from tests.simulate.agent.doubles import ASKED_PLACES, Body, Record, Server


def test_the_outermost_object_comes_first_and_each_side_has_its_hand(run) -> None:
    table = [(0.15, -0.05), (0.15, -0.16), (0.14, 0.10)]
    server = Server()
    run(Body(list(table)), server, [table[1], table[0], table[2]])
    assert [r["gripper_id"] for r in server.asked] == ["right_hand", "right_hand", "left_hand"]


def test_what_was_moved_to_the_side_that_was_done_is_taken_too(run) -> None:
    table = [(0.15, -0.10), (0.15, 0.18), (0.15, 0.08)]

    class Sweeping(Body):
        def execute(self, plan):
            done = super().execute(plan)
            if plan.request.y == table[1][1]:
                self.table[:] = [(0.15, -0.03)]
            return done

    body = Sweeping(list(table))
    run(body, Server(), [table[0], table[1], (0.15, -0.03)])
    assert [request.y for request in body.executed] == [-0.10, 0.18, -0.03]


def test_what_was_hidden_by_a_placed_object_is_another_one(run) -> None:
    spot, beside = (0.15, -0.10), (0.15, -0.06)

    class Hiding(Body):
        def execute(self, plan):
            done = super().execute(plan)
            if plan.request.y == spot[1]:
                self.table[:] = [beside]
            return done

    body = Hiding([spot])
    first, second = run(body, Server(), [spot, beside])
    assert (first.number, second.number) == (1, 2)
    assert first.placed
    assert second.placed


def test_an_object_behind_others_waits_until_they_are_gone(run) -> None:
    outer, inner = (0.15, -0.16), (0.15, -0.05)
    body, server = Body([outer, inner], blocked={outer: 1}), Server()
    first, second = run(body, server, [outer, inner, outer])
    assert [(m.position, m.placed) for m in (first, second)] == [(outer, True), (inner, True)]
    assert [a.reason for a in first.attempts] == ["ok"]
    assert len(server.inserted) == 2


def test_an_object_out_of_reach_is_recorded_with_its_reason_and_not_touched(run) -> None:
    spot = (0.15, -0.1)
    body, server = Body([spot], unreachable=True), Server()
    (met,) = run(body, server, [spot])
    assert not body.planned
    assert server.inserted[0]["outcome"] == {
        "success": False, "placed": False, "reason": "ik", "attempt_number": 1,
    }  # fmt: skip
    assert (met.tries, met.attempts[0].reason, met.attempts[0].physical) == (0, "ik", False)


def test_the_same_seed_asks_with_the_same_seeds(run) -> None:
    spot = (0.15, -0.1)
    asked = []
    for _ in range(2):
        server = Server()
        run(Body([spot]), server, [spot], seed=5)
        asked.append(server.asked[0]["seed"])
    assert asked[0] == asked[1]
    assert 0 <= asked[0] < 2**31


def test_a_grasp_that_can_be_reached_well_goes_before_doubtful_ones(run) -> None:
    body = Body([(0.15, -0.05)], doubted=(0.1, 0.2))
    server = Server(angles=(0.1, 0.1, 0.2, 0.3, 0.4))
    [encounter] = run(body, server, [(0.15, -0.05)])
    assert [request.theta for request in body.planned] == [0.1, 0.2, 0.3]  # alike: planned once
    assert [request.theta for request in body.executed] == [0.3]
    assert encounter.attempts[0].held
    assert server.inserted[0]["grasp"]["rank"] == 4


def test_a_doubtful_grasp_is_better_than_none(run) -> None:
    body = Body([(0.15, -0.05)], doubted=(0.1, 0.2))
    run(body, Server(angles=(0.1, 0.2)), [(0.15, -0.05)])
    assert [request.theta for request in body.executed] == [0.1]


def test_it_leans_only_for_what_no_grasp_reaches_as_it_stands(run) -> None:
    spot = (0.15, -0.05)
    body = Body([spot], only_leaning=(0.1,))
    run(body, Server(angles=(0.1, 0.2)), [spot])
    assert [(r.theta, r.stances) for r in body.executed] == [(0.2, "own")]
    body = Body([spot], only_leaning=(0.1, 0.2))
    run(body, Server(angles=(0.1, 0.2)), [spot])
    assert [(r.theta, r.stances) for r in body.executed] == [(0.1, "other")]


class _Strong(Body):
    """Its pushes part what touches."""

    takes_poses = True

    def push(self, points, others, height, side, seed):
        spot = tuple(np.round(points[0, :2], 3).tolist())
        self.table[self.table.index(spot)] = (spot[0], spot[1] - 0.05)
        return super().push(points, others, height, side, seed)


class _Crowded(Server):
    """Plans nothing on a view; its grasps are those of the thing that is asked about."""

    def __init__(self, body: Body) -> None:
        super().__init__()
        self.body = body

    def plan_on_scene(self, **request):
        return {"segments": [], "grasps": []}

    def recognise_for_grasp(self, **request):
        around = {tuple(point[:2]) for point in request["neighbours"]}
        ASKED_PLACES[:] = [spot for spot in self.body.table if spot not in around] * 99
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


class _Graspless(_Crowded):
    """Has no grasp of anything until something was pushed, and refuses so if asked to decide."""

    def __init__(self, body: Body, decides: bool) -> None:
        super().__init__(body)
        self.decides = decides

    def recognise_for_grasp(self, **request):
        answer = super().recognise_for_grasp(**request)
        if self.body.pushed:
            return answer
        refused = {"too_low": "grasp", "confidence": 0.0, "threshold": 0.1, "refusal": ""}
        return {**answer, "grasps": [], **({"decision": refused} if self.decides else {})}


@pytest.mark.parametrize("decides", [True, False])
def test_what_touches_others_and_has_no_grasp_waits_and_is_pushed(run, decides) -> None:
    body = _Strong([(0.15, -0.10), (0.16, -0.10)])
    met = run(body, _Graspless(body, decides), [])
    assert len(body.pushed) == 1
    assert [[a.reason for a in one.attempts] for one in met] == [["ok"], ["ok"]]
    if decides:
        # The first waits for the second, which waits for the other side alone.
        responses = [[refusal.response for refusal in one.refusals] for one in met]
        assert responses == [["postponed", "postponed"], ["postponed", "pushed"]]


@pytest.mark.parametrize("decides", [True, False])
def test_what_has_no_grasp_and_cannot_be_pushed_is_taken_when_its_neighbour_is_gone(
    run, decides
) -> None:
    stuck = (0.16, -0.10)

    class Cornered(_Strong):
        def push(self, points, others, height, side, seed):
            is_stuck = tuple(np.round(points[0, :2], 3).tolist()) == stuck
            return "" if is_stuck else super().push(points, others, height, side, seed)

    body = Cornered([(0.15, -0.10), stuck])
    met = run(body, _Graspless(body, decides), [])
    found = next(one for one in met if one.position == stuck)
    assert [a.reason for a in found.attempts] == ["refused" if decides else "no_grasp", "ok"]
    assert all(one.placed for one in met)


def test_what_has_no_grasp_is_taken_up_again_once_only(run) -> None:
    class Weak(_Strong):
        def push(self, points, others, height, side, seed):
            self.pushed.append(points)
            return "ok"

    class Never(_Graspless):
        def recognise_for_grasp(self, **request):
            return {**super().recognise_for_grasp(**request), "grasps": []}

    body = Weak([(0.15, -0.10), (0.16, -0.10)])
    met = run(body, Never(body, False), [])
    assert len(body.pushed) == 4  # each twice
    assert [len(one.attempts) for one in met] == [1, 2]


def test_what_stands_free_is_not_pushed(run) -> None:
    body = _Strong([(0.15, -0.1)], unreachable=True)
    (met,) = run(body, _Crowded(body), [])
    assert body.pushed == []
    assert met.attempts[0].reason == "ik"


@pytest.mark.parametrize(("takes_poses", "pushes"), [(True, 0), (False, 2)])
@pytest.mark.parametrize("decides", [True, False])
def test_what_no_hand_closes_on_may_be_two_things_and_is_pushed_at_one_end(
    run, takes_poses: bool, pushes: int, decides: bool
) -> None:
    class Weak(Body):
        def push(self, points, others, height, side, seed):
            self.asked = getattr(self, "asked", 0) + 1
            return "ok"

    class Never(_Graspless):
        def recognise_for_grasp(self, **request):
            return {**super().recognise_for_grasp(**request), "grasps": []}

    body = Weak([(0.15, -0.10)])
    body.takes_poses = takes_poses
    (met,) = run(body, Never(body, decides), [])
    assert getattr(body, "asked", 0) == pushes
    assert not met.held


def test_a_thing_that_was_missed_three_times_in_a_crowd_is_pushed_and_tried_once_more(run) -> None:
    miss = Record("missed", held=False, placed=False)
    body = _Strong([(0.15, -0.16), (0.16, -0.16)], [miss] * 3)
    met = run(body, _Crowded(body), [], max_attempts=4)
    assert sorted(tuple(a.reason for a in one.attempts) for one in met) == [
        ("missed", "missed", "missed", "ok"), ("ok",)
    ]  # fmt: skip
    assert len(body.pushed) == 1


class _Posed(_Strong):
    """Reaches a thing only with the tool in a pose that was planned on the view."""

    def plan(self, request, obstacles, seed):
        return "ik" if request.pose is None else super().plan(request, obstacles, seed)


class _Planner(Server):
    """Plans one grasp of the thing that is in view."""

    def plan_on_scene(self, **request):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = 0.15, -0.1, 0.3
        centre = [0.15, -0.1, 0.3]
        grasp = {
            "id": "candidate:scene-1", "segment": 1, "tool_pose": {"pose": pose_message(pose)},
            "confidence": 0.8, "width": 0.03, "opening": 0.05, "x": 0.15, "y": -0.1, "theta": 0.0,
        }  # fmt: skip
        return {"segments": [{"segment": 1, "centre": centre}], "grasps": [grasp]}


def test_what_the_graph_has_no_reachable_grasp_of_is_grasped_as_planned_on_the_view(run) -> None:
    (met,) = run(_Posed([(0.15, -0.1)]), _Planner(), [])
    assert [(a.source, a.reason) for a in met.attempts] == [("scene", "ok")]
