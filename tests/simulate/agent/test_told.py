"""An agent's reports to the knowledge base on objects, grasps and outcomes."""

from __future__ import annotations

import time

import numpy as np

from simulate.agent.encounter import Attempt, Encounter
from simulate.agent.messages import outcome_message, pose_message
from simulate.grasping.judgement import Judgement
from tests.simulate.agent.doubles import Body, Record, Server


def test_an_object_nobody_knows_is_stored_with_its_view_grasp_and_outcome(run) -> None:
    spot = (0.15, -0.1)
    server = Server()
    (met,) = run(Body([spot]), server, [spot])
    (stored,) = server.inserted
    assert stored["grasp"]["id"] == "candidate:0"
    assert stored["outcome"]["success"] is True
    assert stored["outcome"]["images"][0]["phase"] == "held"
    assert stored["data"]
    assert "object" not in stored
    assert (met.object_iri, met.recognised, met.tries_to_success) == ("o:1", "", 1)


def test_a_well_known_object_is_only_reported_on(run) -> None:
    spot = (0.15, -0.1)
    server = Server(knows=0.95)
    (met,) = run(Body([spot]), server, [spot])
    assert not server.inserted
    assert server.reported[0]["object"] == "o:7"
    assert server.reported[0]["task_id"] == "t:1"
    assert (met.recognised, met.attempts[0].source) == ("o:7", "memory")
    assert not any(asked["in_space"] for asked in server.asked), "this arm takes grasps from above"


def test_a_grasp_planned_on_the_view_is_reported_with_the_view(run) -> None:
    table = [(0.15, -0.16), (0.16, -0.16)]
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = *table[1], 0.3

    class Planning(Server):
        def plan_on_scene(self, **request):
            segments = [{"segment": 4, "centre": [*table[1], 0.3]}]
            grasp = {
                "id": "candidate:scene-1", "kind": "spatial", "segment": 4, "confidence": 0.95,
                "tool_pose": {"pose": pose_message(pose)}, "width": 0.03, "opening": 0.05,
                "x": table[1][0], "y": table[1][1], "theta": 0.0,
            }  # fmt: skip
            return {"segments": segments, "grasps": [grasp]}

    class Posing(Body):
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
    assert all(asked["in_space"] for asked in server.asked), "an arm may recall any pose"


def test_an_object_known_but_not_well_gives_one_more_view(run) -> None:
    spot = (0.15, -0.1)
    server = Server(knows=0.75)
    run(Body([spot]), server, [spot])
    assert server.inserted[0]["object"] == "o:7"


def test_an_attempt_in_a_world_that_broke_down_is_not_told(run) -> None:
    spot = (0.15, -0.1)
    broken, server = Record("not_judged", held=False, placed=False), Server()
    (met,) = run(Body([spot], [broken]), server, [spot] * 2)
    assert [a.reason for a in met.attempts] == ["not_judged", "ok"]
    assert [r["outcome"]["reason"] for r in server.inserted] == ["ok"]


def test_an_agent_tells_when_it_looked_and_when_its_attempts_began_and_ended(run) -> None:
    class Moving(Body):
        def execute(self, plan):
            time.sleep(0.02)  # its simulated time is six seconds
            return super().execute(plan)

    spot, server = (0.15, -0.1), Server()
    before = time.time()
    run(Moving([spot], [Record("missed", held=False, placed=False)]), server, [spot] * 2)
    told = [(one["stamp"], *(one["outcome"][k] for k in ("started", "ended")))
            for one in server.inserted]  # fmt: skip
    order = [before, *told[0], *told[1], time.time()]
    assert len(told) == 2
    assert order == sorted(order)
    assert all(ended - started >= 0.02 for _, started, ended in told)
    assert all(one["outcome"]["duration_s"] == 6.0 for one in server.inserted)


def test_a_thing_that_was_lost_on_the_way_is_reported_as_a_failed_grasp() -> None:
    lost = Record(placed=False, judged_placed=Judgement("no"), place_reason="slip_transport")
    told = outcome_message(
        lost, 1, {"grasps": [{}], "times": {}}, {"rank": 1}, {"ask": 0.1, "plan": 0.1}, [],
        (100.0, 102.0),
    )  # fmt: skip
    assert (told["success"], told["placed"], told["reason"]) == (False, False, "slip_transport")
    assert "motion" not in told
    encounter = Encounter(1, "right", (0.1, 0.1), (0.1, 0.03, 0.03))
    for number, reason in enumerate(("slip_transport", "ok"), start=1):
        encounter.attempts.append(
            Attempt(number, "candidate", "g", "ok", True, reason == "ok", True, 0.5, {},
                    place_reason=reason)
        )  # fmt: skip
    assert encounter.tries_to_success == 2
