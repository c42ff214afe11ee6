"""An agent in doubt: a second look, refusals, and its response to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from features.perception import Perceived
from simulate.agent.decisions import Refusal, Thresholds
from tests.simulate.agent.doubles import ASKED_PLACES, Body, Server, seen_at


class Unsure(Server):
    """A server that is sure only with a second look."""

    def recognise_for_grasp(self, **request):
        self.confidence = 0.95 if "looks" in request else 0.6
        answer = super().recognise_for_grasp(**request)
        if request["unknown"] == "if_new" and not answer["recognition"]["accepted"]:
            answer["decision"] = _too_low("identity", 0.6, 0.7)
        return answer


def test_what_it_is_not_sure_of_the_robot_sees_from_another_place_before_it_asks_again(
    run,
) -> None:
    looked: list[str] = []

    class Turning(Body):
        def look(self, side, camera=None):
            looked.append(side)
            pose = np.eye(4)
            pose[1, 3] = {"right": -0.03, "ahead": 0.0, "left": 0.03}[side]
            return super().look(side)[0], pose

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
    (encounter,) = run(Body([(0.16, -0.1)]), fixed, [(0.16, -0.1)] * 2)
    assert all("looks" not in asked for asked in fixed.asked)
    assert fixed.responses == [("r:identity", "new_object")]
    assert encounter.placed


@pytest.mark.parametrize(("is_cut", "looks"), [(False, 1), (True, 0)])
def test_with_a_fixed_camera_the_robot_asks_again_with_another_one_that_sees_all_of_it(
    run, is_cut: bool, looks: int
) -> None:
    used: list[str | None] = []

    class Standing(Body):
        def look(self, side, camera=None):
            used.append(camera)
            return super().look(side)

    body, server = Standing([(0.16, -0.1)], other_cameras=("box_right",)), Unsure()

    def see(*_: Any) -> Perceived:
        found = tuple(seen_at(x, y) for x, y in body.table)
        if used[-1]:
            found = tuple(replace(one, touches_border=is_cut) for one in found)
        return Perceived("ok", 0.27, found)

    (encounter,) = run(body, server, [(0.16, -0.1)] * 2, see=see)
    assert encounter.recognised == ("o:7" if looks else "")
    assert len(server.asked[1].get("looks", [])) == looks
    assert used[used.index("box_right") + 1] is None  # what follows is planned in the first view


def _too_low(lacking: str, confidence: float, threshold: float) -> dict[str, Any]:
    return {
        "answer": "too_low", "too_low": lacking, "confidence": confidence,
        "threshold": threshold, "refusal": f"r:{lacking}",
    }  # fmt: skip


class _Doubting(Server):
    """Refuses whatever a request asks for by name, and grants what it does not."""

    def __init__(self, lacking: str, **more: Any) -> None:
        super().__init__(**more)
        self.lacking = lacking

    def recognise_for_grasp(self, **request):
        answer = super().recognise_for_grasp(**request)
        if request[f"min_{self.lacking}"] > 0:
            answer |= {"decision": _too_low(self.lacking, 0.05, 0.1), "grasps": []}
        return answer


def test_a_doubtful_pose_is_done_without(run) -> None:
    spot = (0.15, -0.1)
    server = _Doubting("pose", knows=0.95)
    (met,) = run(Body([spot]), server, [spot] * 2, thresholds=Thresholds(pose=0.7))
    assert [asked["min_pose"] for asked in server.asked] == [0.7, 0.0]
    assert server.responses == [("r:pose", "measured_sides")]
    assert met.placed


def test_what_no_grasp_is_likely_to_hold_waits_for_others_and_is_then_left_alone(run) -> None:
    outer, inner = (0.15, -0.16), (0.15, -0.05)

    class Fearing(_Doubting):
        def recognise_for_grasp(self, **request):
            known = ASKED_PLACES[len(self.asked)]
            answer = super().recognise_for_grasp(**request)
            return answer if known == outer else {**answer, "decision": None, "grasps": _at(inner)}

    def _at(spot):
        return [{"id": "g", "source": "candidate", "x": spot[0], "y": spot[1], "z": 0.3,
                 "theta": 0.0, "width": 0.03, "opening": 0.05, "mean": 0.9}]  # fmt: skip

    body, server = Body([outer, inner]), Fearing("grasp")
    first, second = run(body, server, [outer, inner, outer])
    assert server.responses == [("r:grasp", "postponed"), ("r:grasp", "left_alone")]
    assert [(a.reason, a.physical) for a in first.attempts] == [("refused", False)]
    assert second.placed
    assert len(body.executed) == 1
    assert all(asked["decide"] and asked["min_grasp"] == 0.1 for asked in server.asked)
