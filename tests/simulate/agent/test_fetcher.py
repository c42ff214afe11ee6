"""Fetching on request: a table, a hand and a server that behave as told."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

import simulate.agent.agent as agent_module
import simulate.agent.fetcher as fetcher_module
from features.geometry import Frame
from features.perception import Perceived
from simulate.agent import second_look
from simulate.agent.agent import AgentConfig
from simulate.agent.fetcher import Fetched, Fetcher
from tests.simulate.agent.doubles import CAMERA, Plan, Record, seen_at

_CUP, _CAN, _PEN = (0.15, -0.10), (0.15, -0.05), (0.14, 0.10)


@dataclass
class _Body:
    """Holds what it grasps, unless told otherwise; ``vanish`` leaves with the second look."""

    table: list[tuple[float, float]]
    outcomes: dict[tuple[float, float], Record] = field(default_factory=dict)
    unreachable: tuple[tuple[float, float], ...] = ()
    behind: dict[tuple[float, float], tuple[float, float]] = field(default_factory=dict)
    """What the hand cannot get to while another thing stands there."""
    vanish: tuple[float, float] | None = None
    executed: list[tuple[float, float]] = field(default_factory=list)
    looks: int = 0
    base_frame = "base_footprint"
    ignored = ()
    preset = "faithful"
    takes_poses = False
    gripper_ids = {"right": "right_hand", "left": "left_hand"}  # noqa: RUF012 - of the protocol

    def look(self, side: str) -> tuple[Frame, np.ndarray]:
        self.looks += 1
        if self.looks == 3 and self.vanish in self.table:
            self.table.remove(self.vanish)
        return Frame(np.zeros((12, 16), np.float32), CAMERA), np.eye(4)

    def plan(self, request, obstacles, seed):
        if self.behind.get((request.x, request.y)) in self.table:
            return "grasp_collision"
        return "ik" if (request.x, request.y) in self.unreachable else Plan(request)

    def execute(self, plan):
        spot = (plan.request.x, plan.request.y)
        self.executed.append(spot)
        record = self.outcomes.get(spot, Record())
        if record.placed:
            self.table.remove(spot)
        return record, []


@dataclass
class _Server:
    """Knows the cup and the can to drink from; the pen is new to it."""

    body: _Body
    drinks: tuple[str, ...] = ("o:cup", "o:can")
    names = {_CUP: "o:cup", _CAN: "o:can"}  # noqa: RUF012 - read only
    resolved: list[dict] = field(default_factory=list)
    inserted: list[dict] = field(default_factory=list)
    reported: list[dict] = field(default_factory=list)

    def recognise_for_grasp(self, **request):
        spot = LOOKED_AT[-1]
        name = self.names.get(spot, "")
        x, y = spot
        grasp = {"id": "candidate:0", "source": "candidate", "x": x, "y": y, "z": 0.3,
                 "theta": 0.0, "width": 0.03, "opening": 0.05, "mean": 0.9}  # fmt: skip
        return {
            "task_id": "t", "object": name, "label": name.removeprefix("o:"), "grasps": [grasp],
            "times": {"total_s": 0.01},
            "recognition": {
                "accepted": bool(name), "matches": [{"confidence": 0.95}] if name else [],
            },
        }  # fmt: skip

    def resolve_request(self, **request):
        self.resolved.append(request)
        offered = [
            name for name in self.drinks
            if name in request["objects"] and name not in request["exclude"]
        ]  # fmt: skip
        name = offered[0] if offered else ""
        text = f"{name} is for drinking" if name else "nothing to drink from is seen"
        return {"object": name, "label": name.removeprefix("o:"), "explanation": {"text": text}}

    def insert_object(self, objects):
        self.inserted.append(objects[0])
        return {"objects": [{"object": objects[0].get("object", "o:new")}]}

    def report_outcome(self, **report):
        self.reported.append(report)
        return {"stored": 1}


LOOKED_AT: list[tuple[float, float]] = []


@pytest.fixture
def fetch(monkeypatch: pytest.MonkeyPatch):
    """Let a robot fetch; returns (what came of it, body, server)."""

    def _fetch(body: _Body, wanted: str = "something to drink from", **server):
        told = _Server(body, **server)
        monkeypatch.setattr(
            second_look,
            "perceive",
            lambda *_: Perceived("ok", 0.27, tuple(seen_at(x, y) for x, y in body.table)),
        )
        # The fake server must know which thing a crop shows; the crops here are all alike.
        encode = agent_module.observation_message

        def note(seen, *where):
            LOOKED_AT.append((float(seen.position[0]), float(seen.position[1])))
            return encode(seen, *where)

        for module in (agent_module, fetcher_module):
            monkeypatch.setattr(module, "observation_message", note)
        fetched: Fetched = Fetcher(body, told, AgentConfig(max_attempts=2)).fetch(wanted)
        return fetched, body, told

    return _fetch


def test_it_takes_what_the_graph_chose_of_what_it_sees_and_leaves_the_rest(fetch) -> None:
    fetched, body, server = fetch(_Body([_CUP, _CAN, _PEN]))
    assert (fetched.placed, fetched.object, fetched.label) == (True, "o:cup", "cup")
    assert body.executed == [_CUP]
    assert body.table == [_CAN, _PEN]
    assert sorted(server.resolved[0]["objects"]) == ["o:can", "o:cup", "o:new"]
    assert fetched.text == "o:cup is for drinking"


def test_what_nobody_knows_yet_is_told_to_the_graph_before_it_is_asked(fetch) -> None:
    _, _, server = fetch(_Body([_PEN]))
    (told,) = server.inserted
    assert told["data"]
    assert "grasp" not in told
    assert server.resolved[0]["objects"] == ["o:new"]


def test_when_the_first_choice_cannot_be_reached_the_next_one_is_taken(fetch) -> None:
    fetched, body, server = fetch(_Body([_CUP, _CAN], unreachable=(_CUP,)))
    assert (fetched.placed, fetched.object) == (True, "o:can")
    assert [t["reason"] for t in fetched.tried] == ["ik", "ok"]
    assert server.resolved[1]["exclude"] == ["o:cup"]
    assert body.executed == [_CAN]


def test_what_is_in_the_way_goes_into_the_box_first(fetch) -> None:
    fetched, body, _ = fetch(_Body([_CUP, _CAN, _PEN], behind={_CUP: _CAN}), drinks=("o:cup",))
    assert body.executed == [_CAN, _CUP]
    assert (fetched.placed, fetched.object, fetched.moved) == (True, "o:cup", ("o:can",))
    assert [t["reason"] for t in fetched.tried] == ["grasp_collision", "ok"]
    assert "1 thing in the way went into the box" in fetched.text


def test_nothing_is_moved_while_another_choice_can_be_reached(fetch) -> None:
    fetched, body, _ = fetch(_Body([_CUP, _CAN], behind={_CUP: _CAN}))
    assert (body.executed, fetched.object, fetched.moved) == ([_CAN], "o:can", ())


def test_what_cannot_be_reached_alone_is_given_up(fetch) -> None:
    alone = _Body([_CUP, _PEN], behind={_CUP: _CUP})
    fetched, body, _ = fetch(alone, drinks=("o:cup",))
    assert (fetched.placed, body.executed) == (False, [])
    assert fetched.text.startswith("cup: grasp_collision")


def test_when_nothing_of_it_is_there_nothing_moves_and_it_says_so(fetch) -> None:
    fetched, body, _ = fetch(_Body([_PEN]))
    assert (fetched.placed, fetched.object, fetched.tried) == (False, "", ())
    assert not body.executed
    assert fetched.text == "nothing to drink from is seen"


def test_an_empty_table_is_no_error(fetch) -> None:
    fetched, _, server = fetch(_Body([]))
    assert not fetched.placed
    assert server.resolved[0]["objects"] == []


def test_what_was_taken_away_meanwhile_is_gone_and_the_next_one_is_taken(fetch) -> None:
    fetched, body, _ = fetch(_Body([_CUP, _CAN], vanish=_CUP))
    assert [t["reason"] for t in fetched.tried] == ["gone", "ok"]
    assert body.executed == [_CAN]


def test_what_slips_every_time_is_given_up_with_its_reason(fetch) -> None:
    slips = Record("slip_lift", held=False, placed=False, place_reason="")
    fetched, body, server = fetch(_Body([_CUP], {_CUP: slips}))
    assert (fetched.placed, body.executed) == (False, [_CUP, _CUP])
    assert fetched.text == "cup: slip_lift; nothing to drink from is seen"
    assert [r["outcome"]["reason"] for r in server.reported] == ["slip_lift"] * 2


def test_what_falls_on_the_way_names_the_phase_that_failed(fetch) -> None:
    dropped = Record(placed=False, place_reason="drop_outside")
    fetched, _, _ = fetch(_Body([_CUP], {_CUP: dropped}))
    assert fetched.tried[0]["reason"] == "drop_outside"
