"""A thing that came to lie against another is seen as one with it; a push parts the two."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from features.geometry import FloatArray
from features.perception import Perceived, Seen
from simulate.agent.pushes import Pushes
from simulate.agent.tracking import TrackedObject
from tests.simulate.agent.doubles import Body, Record, Server, seen_at


@dataclass
class _Pusher:
    pushed: list[tuple[FloatArray, list[FloatArray]]] = field(default_factory=list)

    def push(self, points, others, height, side, seed):
        self.pushed.append((points, list(others)))
        return "ok"


def _pair() -> Seen:
    """Return two things of 3 cm beside each other, as one."""
    alone = seen_at(0.15, -0.10)
    xs = np.linspace(0.12, 0.18, 61)
    points = np.stack([xs, np.full(61, -0.10), np.full(61, 0.3)], axis=1)
    return replace(alone, points=points, shape=replace(alone.shape, length=0.06))


def test_what_is_seen_as_one_with_its_neighbour_is_pushed_at_one_end() -> None:
    body = _Pusher()
    pushes = Pushes(body)
    track = TrackedObject(1, seen_at(0.15, -0.10))
    track.meet()
    track.seen = _pair()
    assert pushes.push(track, Perceived("ok", 0.27, (track.seen,)), "right", 0) == "ok"
    ((pushed, (rest,)),) = body.pushed
    assert len(pushed) + len(rest) == 61
    assert abs(float(pushed[:, 0].mean() - rest[:, 0].mean())) > 0.025


def test_what_was_as_large_when_the_robot_came_to_it_stands_free_and_is_not_pushed() -> None:
    body = _Pusher()
    track = TrackedObject(1, _pair())
    track.meet()
    assert Pushes(body).push(track, Perceived("ok", 0.27, (track.seen,)), "right", 0) == ""
    assert body.pushed == []


@pytest.mark.parametrize("is_pair", [False, True])
def test_a_view_of_two_things_as_one_is_not_stored_as_a_view_of_either(
    run, monkeypatch: pytest.MonkeyPatch, is_pair: bool
) -> None:
    monkeypatch.setattr(TrackedObject, "has_grown", property(lambda track: is_pair))
    spot, server = (0.15, -0.1), Server()
    run(Body([spot], [Record("missed", held=False, placed=False)]), server, [spot] * 2)
    told = [report["outcome"]["attempt_number"] for report in server.reported]
    stored = [item["outcome"]["attempt_number"] for item in server.inserted]
    assert (stored, told) == (([1], [2]) if is_pair else ([1, 2], []))
