"""An agent plans on the whole view where things touch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rtask
from features.geometry import Frame
from features.perception import Perceived
from grasp.messages import pose_message
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.crowd import Crowd, touching
from simulate.agent.messages import distinct, grasp_request, tool_pose
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.agent.tracking import TrackedObject
from simulate.robots import describe
from simulate.world.objects import product
from simulate.world.scene import Placement
from tests.simulate.agent.doubles import CAMERA, seen_at

VIEW = Frame(np.full((12, 16), 0.3, np.float32), CAMERA, np.zeros((12, 16, 3), np.uint8))

PRIORS = """PREFIX rt: <https://w3id.org/rtask-kg/ns#>
SELECT ?alpha ?beta ?policy { ?attempt a rt:GraspAttempt
    OPTIONAL { ?attempt rt:priorAlpha ?alpha ; rt:priorBeta ?beta ; rt:policyVersion ?policy } }"""


class _Planner:
    """Answers with the same grasps each time."""

    def __init__(self, *grasps: tuple[int, float, float]) -> None:
        self.asked: list[dict[str, Any]] = []
        self.grasps = [a_grasp(*grasp) for grasp in grasps]

    def plan_on_scene(self, **request: Any) -> dict[str, Any]:
        self.asked.append(request)
        segments = [
            {"segment": 1, "centre": [0.4, 0.0, 0.3]}, {"segment": 2, "centre": [0.41, 0.0, 0.3]},
            {"segment": 3, "centre": [0.8, 0.0, 0.3]},
        ]  # fmt: skip
        return {"segments": segments, "grasps": self.grasps}


def a_grasp(segment: int, confidence: float, height: float) -> dict[str, Any]:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 0.4, 0.0, height
    return {
        "id": f"candidate:scene-{segment}", "kind": "spatial", "segment": segment,
        "tool_pose": {"pose": pose_message(pose)}, "confidence": confidence,
        "width": 0.03, "opening": 0.05, "x": 0.4, "y": 0.0, "theta": 0.0,
    }  # fmt: skip


def two_that_touch() -> tuple[Perceived, list[TrackedObject]]:
    seen = (seen_at(0.40, 0.0), seen_at(0.41, 0.0))
    return Perceived("ok", 0.27, seen), [TrackedObject(k + 7, one) for k, one in enumerate(seen)]


def test_things_that_stand_apart_are_not_planned_on_together() -> None:
    near, far = seen_at(0.40, 0.0), seen_at(0.45, 0.0)
    assert touching([near, far]) == []
    close = seen_at(0.41, 0.0)
    assert [id(one) for one in touching([near, far, close])] == [id(near), id(close)]
    planner = _Planner((1, 0.9, 0.3))
    crowd, track = Crowd(planner), TrackedObject(1, near)
    crowd.look(VIEW, np.eye(4), Perceived("ok", 0.27, (near, far)), [track], {})
    assert not planner.asked
    assert crowd.first([track]) is None
    assert crowd.merged(track, [{"source": "candidate"}], 10) == [{"source": "candidate"}]


def test_the_thing_with_the_best_grasp_comes_first_and_a_failed_grasp_not_again() -> None:
    view, (one, other) = two_that_touch()
    crowd = Crowd(_Planner((2, 0.9, 0.30), (3, 0.8, 0.3), (1, 0.7, 0.3), (2, 0.6, 0.35)))
    crowd.look(VIEW, np.eye(4), view, [one, other], {"seed": 5})
    assert crowd.first([one, other]) is other
    known = {"source": "memory", "mean": 0.95}
    doubtful = {"source": "memory", "mean": 0.5}
    found = crowd.merged(other, [doubtful, known], 1)
    assert [grasp["source"] for grasp in found] == ["memory", "scene", "memory"]
    assert (found[0], found[2]) == (known, doubtful)

    crowd.fail(other, found[1])
    crowd.look(VIEW, np.eye(4), view, [one, other], {"seed": 6})
    assert crowd.first([one, other]) is one
    assert [g["confidence"] for g in crowd.merged(other, [], 10)] == [0.6]
    one.waiting = True
    assert crowd.first([one, other]) is other


def test_each_failure_takes_from_what_other_plans_of_the_view_promise() -> None:
    view, (one, other) = two_that_touch()
    crowd = Crowd(_Planner((1, 0.9, 0.30), (1, 0.8, 0.35), (1, 0.8, 0.40)))
    graph = [{"source": "candidate", "mean": 0.5}]
    for left in (3, 2, 1):
        crowd.look(VIEW, np.eye(4), view, [one, other], {})
        found = crowd.merged(one, graph, 10)
        assert len(found) == left + 1
        if left > 1:  # .9, then .8 of which one failure leaves two thirds
            assert found[0]["source"] == "scene"
        else:  # two leave the half
            assert found[0] is graph[0]
            return
        crowd.fail(one, found[0])


def test_what_stands_free_beside_a_crowd_has_no_grasps_of_the_view() -> None:
    view, (one, other) = two_that_touch()
    free = TrackedObject(9, seen_at(0.8, 0.0))
    crowd = Crowd(_Planner((2, 0.9, 0.3), (3, 0.95, 0.3)))
    view = Perceived("ok", 0.27, (*view.objects, free.seen))
    crowd.look(VIEW, np.eye(4), view, [one, other, free], {})
    assert crowd.first([free]) is None
    assert crowd.first([one, other, free]) is other


def test_what_stands_free_is_planned_on_when_it_is_asked_for_and_once_a_view() -> None:
    free = TrackedObject(9, seen_at(0.8, 0.0))
    planner = _Planner((3, 0.95, 0.3))
    crowd = Crowd(planner)
    assert not crowd.look_closer(free)  # nothing has been seen yet
    for looks in (1, 2):
        crowd.look(VIEW, np.eye(4), Perceived("ok", 0.27, (free.seen,)), [free], {"seed": 5})
        assert not crowd.has_grasps(free)
        assert crowd.look_closer(free)
        assert crowd.look_closer(free)
        assert len(planner.asked) == looks
    assert planner.asked[0]["seed"] == 5
    assert [g["source"] for g in crowd.merged(free, [], 10)] == ["scene"]


def test_a_thing_of_the_other_side_keeps_its_grasps_to_itself() -> None:
    view, (one, _) = two_that_touch()
    crowd = Crowd(_Planner((2, 0.9, 0.3), (1, 0.7, 0.3)))
    crowd.look(VIEW, np.eye(4), view, [one], {})
    assert [g["confidence"] for g in crowd.merged(one, [], 10)] == [0.7]


def test_a_grasp_in_space_is_asked_of_the_arm_as_it_is() -> None:
    _, (one, _) = two_that_touch()
    grasp = a_grasp(1, 0.9, 0.33)
    request = grasp_request(one, grasp, 0.27, "own")
    assert np.array_equal(request.pose, tool_pose(grasp))
    assert (request.width, request.opening, request.z) == (0.03, 0.05, 0.33)
    assert len(distinct([grasp, a_grasp(1, 0.8, 0.31)])) == 2


@pytest.mark.slow
def test_the_agent_takes_what_touches_and_reports_the_pose(tmp_path) -> None:
    """Camera, engine, planner and physics as they are."""
    place = describe("panda").workplace
    x = sum(place.area_x) / 2
    touching = [
        Placement(product("can", 3), x, -0.14, 0.0), Placement(product("box", 2), x, -0.103, 0.0)
    ]  # fmt: skip
    body = SimulatedBody(touching, tmp_path, Conditions(robot="panda", preset="fast"))
    try:
        with rtask.open(":memory:") as kb, rtask.connect(kb, agent="panda-1") as client:
            client.call("register_robot", **body.robot.describe("panda-1"))
            met = Agent(body, client, AgentConfig(seed=1)).clear_table()
            holder = next(
                one for one in met if any(a.source == "scene" and a.held for a in one.attempts)
            )
            known = client.recall_grasps(object=holder.object_iri)["grasps"]
            priors = client.query(PRIORS)
    finally:
        body.close()
    assert "spatial" in {grasp["kind"] for grasp in known}
    assert priors
    assert all(row.get(name) is not None for row in priors for name in ("alpha", "beta", "policy"))
