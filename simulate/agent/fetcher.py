"""The agent that fetches an object for a request in words.

The engine interprets the words by reasoning over classes and functions (Gatto 2016, 5); the robot
supplies the objects that it sees and acts on the answer. If it cannot, it says why.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from features.perception import Perceived
from simulate.agent.agent import Agent, AgentConfig, Body, Server
from simulate.agent.messages import observation_message
from simulate.agent.second_look import View, look_at_side
from simulate.agent.tracking import TrackedObject
from simulate.world.seeds import mix_seed

__all__ = ["Fetched", "Fetcher"]

_SIDES = ("right", "left")
_IN_THE_WAY = ("grasp_collision", "approach_collision", "pregrasp_collision")
_BESIDE_M = 0.12
_MAX_MOVED = 3


class RequestServer(Server, Protocol):
    """Operations of the engine that the fetcher calls."""

    def resolve_request(self, **request: Any) -> dict[str, Any]: ...


@dataclass(frozen=True)
class Fetched:
    """Outcome of a request.

    Parameters
    ----------
    wanted
        The request in words.
    seen
        IRIs of the objects on the table, in the order in which they were seen.
    object, label
        The object that was taken; empty if none was.
    placed
        Whether the object is in its box.
    text
        Which object was chosen and why, or why nothing could be brought.
    tried
        For each object that was tried: ``object``, ``label``, ``reason`` (``ok`` = placed).
    moved
        IRIs of objects that were in the way and were put into the box before.
    answer
        The engine's last answer.
    """

    wanted: str
    seen: tuple[str, ...]
    object: str
    label: str
    placed: bool
    text: str
    tried: tuple[dict[str, str], ...]
    answer: dict[str, Any]
    moved: tuple[str, ...] = ()


class Fetcher(Agent):
    """Agent that fetches one object on request.

    Parameters
    ----------
    body, server, config
        As of :class:`simulate.agent.agent.Agent`.
    """

    def __init__(self, body: Body, server: RequestServer, config: AgentConfig) -> None:
        super().__init__(body, cast(Server, server), config)
        self._requests = server
        self._moved: list[str] = []

    def fetch(self, description: str) -> Fetched:
        """Fetch an object that matches the words, or report why not.

        If the first choice cannot be taken, the next one is tried, and so on. If none can, what is
        in the way of one goes into the box first.
        """
        tracks = {track.object_iri: (track, side) for track, side in self._survey()}
        tried: list[dict[str, str]] = []
        while True:
            answer = self._requests.resolve_request(
                wanted=description,
                gripper_id=next(iter(self.body.gripper_ids.values())),
                objects=list(tracks),
                # What was tried is not offered again, or one thing that slips would be tried for
                # ever.
                exclude=[attempt["object"] for attempt in tried],
            )
            chosen = str(answer["object"])
            if chosen not in tracks:
                self._make_room(tracks, tried)
                return self._sum_up(description, tuple(tracks), tried, answer)
            reason = self._take(*tracks[chosen])
            tried.append({"object": chosen, "label": str(answer["label"]), "reason": reason})
            if reason == "ok":
                return self._sum_up(description, tuple(tracks), tried, answer)

    def _make_room(
        self, tracks: Mapping[str, tuple[TrackedObject, str]], tried: list[dict[str, str]]
    ) -> None:
        """Try again what others kept the hand from, after putting these into the box one by one."""
        for earlier in list(tried):
            if earlier["reason"] not in _IN_THE_WAY:
                continue
            track, side = tracks[earlier["object"]]
            for other in self._beside(track)[:_MAX_MOVED]:
                if self._take(other, side) != "ok":
                    continue
                self._moved.append(other.object_iri)
                track.finished = False
                reason = self._take(track, side)
                tried.append({**earlier, "reason": reason})
                if reason == "ok":
                    return
                # What is left is no matter of room: to empty the table further would help nothing.
                if reason not in _IN_THE_WAY:
                    break

    def _beside(self, track: TrackedObject) -> list[TrackedObject]:
        """Return what stands around a thing on its side, the nearest first."""

        def away(other: TrackedObject) -> float:
            return float(np.linalg.norm(other.seen.position - track.seen.position))

        around = self._tracker.in_view(1 if track.seen.position[1] >= 0 else -1)
        others = [
            neighbour for neighbour in around if neighbour is not track and not neighbour.finished
        ]
        return sorted((neighbour for neighbour in others if away(neighbour) < _BESIDE_M), key=away)

    def _survey(self) -> list[tuple[TrackedObject, str]]:
        """Look at both sides and find or add every object in the graph."""
        met = []
        # Both sides before any choice: the better thing may stand on the other one.
        for side in _SIDES:
            _, base_from_camera, view = self._look(side, None)
            for track in self._tracker.in_view(-1 if side == "right" else 1):
                self._name(track, side, view, base_from_camera)
                met.append((track, side))
        return [(track, side) for track, side in met if track.object_iri]

    def _look(self, side: str, handled: TrackedObject | None) -> View:
        return look_at_side(self.body, self._tracker, handled, side)

    def _name(
        self,
        track: TrackedObject,
        side: str,
        view: Perceived,
        base_from_camera: NDArray[np.float64],
    ) -> None:
        """Recognise a thing, or add it to the graph as it looks."""
        encounter = self._encounter(track, side)
        frame_id = self.body.base_frame
        observation = observation_message(track.seen, view, base_from_camera, frame_id)
        gripper_id = self.body.gripper_ids[side]
        answer = self.server.recognise_for_grasp(
            gripper_id=gripper_id, seed=mix_seed(self.config.seed, track.number), **observation
        )
        self._first_sight(encounter, track, answer)
        if not track.object_iri:
            inserted = self.server.insert_object(
                objects=[{**observation, "gripper_id": gripper_id}]
            )
            track.object_iri = inserted["objects"][0]["object"]
        encounter.object_iri = track.object_iri

    def _take(self, track: TrackedObject, side: str) -> str:
        """Pick and place one object; return ``ok`` or the reason why not."""
        encounter = self._encounter(track, side)
        for _ in range(self.config.max_looks):
            started = time.perf_counter()
            _, base_from_camera, view = self._look(side, track)
            if not track.visible:
                return "gone"
            looked_s = time.perf_counter() - started
            self._attempt(track, side, view, base_from_camera, looked_s, may_wait=False)
            if track.finished:
                break
        if encounter.placed:
            return "ok"
        last = encounter.attempts[-1]
        return last.place_reason or last.reason if last.held else last.reason

    def _sum_up(
        self,
        wanted: str,
        seen: tuple[str, ...],
        tried: list[dict[str, str]],
        answer: dict[str, Any],
    ) -> Fetched:
        last = tried[-1] if tried else {"object": "", "label": "", "reason": ""}
        placed = last["reason"] == "ok"
        lines = [] if placed else [f"{t['label'] or t['object']}: {t['reason']}" for t in tried]
        lines.append(str(answer["explanation"]["text"]))
        if self._moved:
            count = len(self._moved)
            lines.append(f"{count} thing{'s' * (count > 1)} in the way went into the box before")
        return Fetched(
            wanted,
            seen,
            last["object"] if placed else "",
            last["label"] if placed else "",
            placed,
            "; ".join(lines),
            tuple(tried),
            answer,
            tuple(self._moved),
        )
