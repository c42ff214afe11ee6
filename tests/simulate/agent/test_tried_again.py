"""An agent whose grasp fails: it tries again, and looks for what has moved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from features.perception import Perceived
from simulate.grasping.judgement import Judgement
from tests.simulate.agent.doubles import Body, Record, Server, seen_at


def test_after_a_miss_the_robot_tries_again_and_says_which_object_it_is(run) -> None:
    spot = (0.15, -0.1)
    miss = Record("missed", held=False, placed=False)
    server = Server()
    (met,) = run(Body([spot], [miss, miss]), server, [spot] * 3)
    assert "object" not in server.asked[0]
    assert server.asked[1]["object"] == server.asked[2]["object"] == "o:1"
    assert [a.reason for a in met.attempts] == ["missed", "missed", "ok"]
    assert met.tries_to_success == 3
    assert [r["outcome"]["attempt_number"] for r in server.inserted] == [1, 2, 3]


def test_the_robot_gives_up_after_its_last_attempt(run) -> None:
    spot = (0.15, -0.1)
    miss = Record("missed", held=False, placed=False)
    (met,) = run(Body([spot], [miss] * 9), Server(), [spot] * 9, max_attempts=3)
    assert met.tries == 3
    assert met.tries_to_success is None
    assert not met.held


def test_held_but_dropped_on_the_way_counts_as_held_and_is_tried_again(run) -> None:
    spot = (0.15, -0.1)
    dropped = replace(Record(), placed=False)
    (met,) = run(Body([spot], [dropped]), Server(), [spot] * 2)
    assert (met.tries_to_success, met.tries, met.placed) == (1, 2, True)


def test_an_object_that_turns_up_elsewhere_goes_on_where_it_was_left(run) -> None:
    """It vanishes for a look, and is recognised where nobody put it."""
    spot, other, far = (0.15, -0.16), (0.15, -0.05), (0.30, -0.10)
    body = Body([spot, other], [Record("missed", held=False, placed=False)])
    server = Server(knows=0.95)
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


def _away(body: Body, to: tuple[float, float] | None) -> None:
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
    body, server = Body([spot], [Record("missed", held=False, placed=False)]), Server()
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
    body = Body(list(spots), [miss, miss])
    execute = body.execute

    def rolls(plan):
        result = execute(plan)
        if len(body.executed) <= 2:
            body.table.remove((plan.request.x, plan.request.y))
        if len(body.executed) == 2:
            body.table.append(there)
        return result

    body.execute = rolls
    first, second, third = run(body, Server(), [*spots, there])
    assert (first.lost, second.lost, third.lost) == (True, True, False)
    assert third.placed


def test_what_is_nowhere_is_said_to_be_lost(run) -> None:
    spot, told = (0.15, -0.1), []
    body = Body([spot], [Record("missed", held=False, placed=False)])
    _away(body, None)
    looks: list[str] = []
    look = body.look
    body.look = lambda side: looks.append(side) or look(side)
    (met,) = run(body, Server(), [spot], on_event=lambda name, data: told.append((name, data)))
    assert met.lost
    assert ("missing", {"object": 1, "title": "object 1", "last_seen": [0.15, -0.1]}) in told
    assert looks[-2:] == ["right", "left"]
    assert looks.count("left") < 8  # it does not search for ever


@pytest.mark.parametrize("is_new_there", [True, False])
def test_what_is_nowhere_else_is_the_new_thing_in_the_box(run, is_new_there: bool) -> None:
    spot, told = (0.15, -0.1), []
    seen = Judgement("unknown", "a part of it may lie there", is_new_there)
    slipped = Record(placed=False, judged_placed=seen, place_reason="slip_transport")
    body = Body([spot], [slipped])
    _away(body, None)
    (met,) = run(body, Server(), [spot], on_event=lambda name, data: told.append((name, data)))
    assert (met.placed, met.lost) == (is_new_there, not is_new_there)
    assert met.tries_to_success is None  # the grasp failed all the same
    names = [name for name, _ in told]
    assert ("found" in names, "missing" in names) == (is_new_there, not is_new_there)
    assert ("nowhere on the table" in met.attempts[-1].evidence) is is_new_there


def test_what_turns_up_again_is_not_in_the_box(run) -> None:
    spot, there = (0.15, -0.1), (0.16, -0.04)
    seen = Judgement("unknown", "a part of it may lie there", is_new_there=True)
    slipped = Record(placed=False, judged_placed=seen, place_reason="slip_transport")
    body = Body([spot], [slipped])
    _away(body, there)
    (met,) = run(body, Server(), [spot, there])
    assert [a.placed for a in met.attempts] == [False, True]


def test_what_is_hidden_from_one_side_is_looked_for_from_another(run) -> None:
    spot, there = (0.15, -0.1), (0.15, -0.04)
    sees: list[str] = []

    class Turning(Body):
        def look(self, side, camera=None):
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

    server = Server()
    (met,) = run(body, server, [spot, there], see=perceived)
    assert [a.reason for a in met.attempts] == ["missed", "ok"]
    assert sees[sees.index("ahead") + 1] == "right"  # the head is back
    assert server.asked[1]["sensor_pose"]["position"]["y"] == 0.0


@pytest.mark.parametrize(
    ("confidence", "recognised", "stored"), [(0.5, "o:1", "o:1"), (0.2, "", None)]
)
def test_what_is_knocked_out_of_the_box_is_not_stored_a_second_time(
    run, confidence: float, recognised: str, stored: str | None
) -> None:
    # It lies on a side that the graph has not seen, so that it is hardly recognised.
    spot, other, there = (0.15, -0.16), (0.15, -0.05), (0.25, -0.16)
    body, server = Body([spot, other]), Server()
    execute, asked = body.execute, server.recognise_for_grasp

    def knocks_out(plan):
        result = execute(plan)
        if len(body.executed) == 2:
            body.table.append(there)
        return result

    def resembles(**request):
        answer = asked(**request)
        if len(server.asked) == 3:
            match = {"object": "o:1", "label": "can 1", "confidence": confidence}
            answer["recognition"]["matches"] = [match]
        return answer

    body.execute, server.recognise_for_grasp = knocks_out, resembles
    *_, third = run(body, server, [spot, other, there])
    assert (third.recognised, third.placed) == (recognised, True)
    assert server.inserted[2].get("object") == stored


def test_the_name_that_somebody_gave_is_stored_with_a_new_object_and_said_of_it(run) -> None:
    spot, told = (0.15, -0.1), []
    server = Server()

    def names(encounter: Any, seen: Any) -> None:
        encounter.name = "carton-7"

    miss = Record("missed", held=False, placed=False)
    (met,) = run(
        Body([spot], [miss]), server, [spot] * 2,
        on_event=lambda name, data: told.append(data), on_sight=names,
    )  # fmt: skip
    assert [item.get("name") for item in server.inserted] == ["carton-7", None]
    assert {data["title"] for data in told if "object" in data} == {"carton-7"}
    assert met.summary()["name"] == "carton-7"
