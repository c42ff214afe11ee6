"""The agent that clears a table: look, ask the graph, grasp, judge, report.

The agent uses only its camera, its joints and the server. It has no access to ground truth about
the scene, which :mod:`simulate.agent.scoring` uses afterwards, from outside.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.perception import Perceived, Seen, neighbour_points
from simulate.agent.crowd import Crowd, touching
from simulate.agent.decisions import Thresholds, ask_for_decision
from simulate.agent.encounter import Attempt, Encounter
from simulate.agent.grasp_choice import GraspChoice, choose_grasp
from simulate.agent.interfaces import Body, Server
from simulate.agent.messages import observation_message, outcome_message
from simulate.agent.pushes import Pushes
from simulate.agent.second_look import look_at_side, seen_from_aside
from simulate.agent.tracking import TrackedObject, Tracker
from simulate.grasping.executor import PlannedGrasp
from simulate.world.seeds import mix_seed

__all__ = ["Agent", "AgentConfig", "Attempt", "Body", "Encounter", "Server"]

log = logging.getLogger(__name__)

_CONFIDENT = 0.9
_SIDES = ("right", "left")
_RESEMBLES = 0.35
"""Half of what the graph accepts: enough to know again what this robot had put into a box."""
_LIKELY = 0.5
"""From here on, the graph asks for another view."""


@dataclass(frozen=True)
class AgentConfig:
    """Limits on attempts, plans and looks, and the seed of an agent.

    Parameters
    ----------
    max_attempts
        Physical attempts at one object.
    max_plans
        Number of grasps per answer that are planned before the object counts as out of reach.
    max_looks
        Number of views of one side of the table, a guard against a scene that never settles.
    max_searches
        How often both sides are searched again for objects that went out of sight.
    seed
        Seed of every choice that the server makes for this robot.
    thresholds
        Least confidences for a grasp.
    """

    max_attempts: int = 4
    max_plans: int = 10
    max_looks: int = 40
    max_searches: int = 2
    seed: int = 0
    thresholds: Thresholds = field(default_factory=Thresholds)


@dataclass(frozen=True)
class _Try:
    """One try at an object.

    Parameters
    ----------
    encounter, track
        The object, as it is accounted for and as it is tracked.
    observation
        Its view, as a message.
    answer
        The server's, with the grasps that were planned on the view.
    number
        Of the try, from 1.
    seconds
        Time of each step, s.
    """

    encounter: Encounter
    track: TrackedObject
    observation: dict[str, Any]
    answer: dict[str, Any]
    number: int
    seconds: dict[str, float]


class Agent:
    """Clears a table: asks the graph about each object, grasps it and reports the outcome.

    Parameters
    ----------
    body
        The robot's cameras and arms.
    server
        The shared graph.
    config
        Limits and seed.
    on_event
        Called with (name, data) at every noteworthy step.
    on_sight
        Called with an encounter and the object's pixels after its first recognition; a hook for
        scoring, which may also give the object the name under which it is stored and reported.
    on_frame
        Called with every frame taken, for observers.
    """

    def __init__(
        self,
        body: Body,
        server: Server,
        config: AgentConfig,
        on_event: Callable[[str, dict[str, Any]], None] = lambda name, data: None,
        on_sight: Callable[[Encounter, Seen], None] = lambda encounter, seen: None,
        on_frame: Callable[[Frame], None] = lambda frame: None,
    ) -> None:
        self.body = body
        self.server = server
        self.config = config
        self.encounters: dict[int, Encounter] = {}
        self._tell = on_event
        self._on_sight = on_sight
        self._on_frame = on_frame
        self._tracker = Tracker()
        self._crowd = Crowd(server)
        self._pushes = Pushes(body)
        self._is_searching = False
        self._runs = 0

    def clear_table(self) -> list[Encounter]:
        """Handle every object on both sides; return the encounters in order.

        What went out of sight, because it rolled to the other side or behind something, is
        searched for on both sides. What touches other things and cannot be grasped is put off until
        both sides have been cleared of what can be: its neighbours may be gone by then.
        """
        for search in range(1 + self.config.max_searches):
            self._is_searching, runs = search > 0, self._runs
            put_off = [self._clear_side(side, is_patient=search == 0) for side in _SIDES]
            if any(put_off):
                for track in self._tracker.tracks:
                    track.waiting = False
                for side in _SIDES:
                    self._clear_side(side)
            if not self._tracker.missing or (search and runs == self._runs):
                break
        for track in self._tracker.missing:
            if track.number in self.encounters:
                self._give_up_search(track, self.encounters[track.number])
        return list(self.encounters.values())

    def _give_up_search(self, track: TrackedObject, encounter: Encounter) -> None:
        """Conclude where a thing is that was found on neither side of the table.

        It is in the box if something new lies there that could not be told to be it or not; else
        it is lost.
        """
        x, y = (round(float(v), 3) for v in track.seen.position[:2])
        about = _about(track, encounter)
        if track.may_lie_in_box:
            encounter.conclude_placed()
            self._tell("found", about | {"where": "in the box, as it is nowhere on the table"})
            return
        encounter.lost = True
        self._tell("missing", about | {"last_seen": [x, y]})

    def _clear_side(self, side: str, is_patient: bool = False) -> bool:
        """Handle the objects on one side; tell whether a patient robot has put some off."""
        handled: TrackedObject | None = None
        sign = -1 if side == "right" else 1
        for number in range(self.config.max_looks):
            started = time.perf_counter()
            frame, base_from_camera, view = look_at_side(self.body, self._tracker, handled, side)
            looked_s = time.perf_counter() - started
            self._on_frame(frame)
            tracks = self._tracker.in_view(sign)
            self._pushes.resume(tracks)
            self._tell("look", {"side": side, "status": view.status, "objects": len(tracks)})
            todo = [track for track in tracks if not track.finished]
            if not todo:
                return False
            crowded = touching(view.objects) if is_patient else []
            in_crowd = [t for t in todo if any(t.seen is seen for seen in crowded)]
            if in_crowd and all(t.waiting for t in todo):
                return True
            if self.body.takes_poses:
                request = {"gripper_id": self.body.gripper_ids[side],
                           "frame_id": self.body.base_frame,
                           "seed": mix_seed(self.config.seed, number)}  # fmt: skip
                self._crowd.look(frame, base_from_camera, view, todo, request)
            # The best grasp in a crowd, else the outermost: the hand comes from outside, and each
            # success clears its path. What was out of reach behind others waits for them to go.
            handled = self._crowd.first(todo) or max(
                todo, key=lambda t: (not t.waiting, t.seen.position[1] * sign)
            )
            others_first = any(not t.waiting for t in todo if t is not handled)
            may_wait = others_first or any(t is handled for t in in_crowd)
            self._attempt(handled, side, view, base_from_camera, looked_s, may_wait)
        return False

    def _attempt(
        self,
        track: TrackedObject,
        side: str,
        view: Perceived,
        base_from_camera: NDArray[np.float64],
        looked_s: float,
        may_wait: bool,
    ) -> None:
        """Ask about an object and plan; grasp it, push it, put it off or give it up."""
        encounter = self._encounter(track, side)
        if self._pushes.are_due(track, encounter.tries) and self._push(track, view, side):
            return
        seconds = {"look": looked_s}
        started = time.perf_counter()
        frame_id = self.body.base_frame
        observation = observation_message(track.seen, view, base_from_camera, frame_id)
        seconds["encode"] = time.perf_counter() - started
        started = time.perf_counter()
        request = self._request(encounter, track, view, side) | observation
        waits = may_wait and not track.waiting
        decided = ask_for_decision(
            self.server, request, lambda: seen_from_aside(self.body, track, side),
            lambda: self._crowd.look_closer(track), waits,
            lambda has_grasp: self._push(track, view, side, has_grasp),
        )  # fmt: skip
        answer = decided.answer
        seconds["ask"] = time.perf_counter() - started
        if not encounter.is_seen:
            encounter = self._first_sight(encounter, track, answer)
        encounter.refusals += decided.refusals
        started = time.perf_counter()
        planned = GraspChoice(None, None, "refused")
        if not decided.ends:
            answer, planned = self._choose(track, view, answer, encounter.tries > 0)
        seconds["plan"] = time.perf_counter() - started
        trial = _Try(encounter, track, observation, answer, encounter.tries + 1, seconds)
        if planned.plan is not None and planned.grasp is not None:
            self._grasp(trial, planned.plan, planned.grasp)
        elif waits:
            track.waiting = True
        elif decided.ends != "pushed" and (
            decided.ends or not self._push(track, view, side, planned.grasp is not None)
        ):
            self._give_up(trial, planned)
            if planned.grasp is None:
                self._pushes.leave(track, view)

    def _request(
        self, encounter: Encounter, track: TrackedObject, view: Perceived, side: str
    ) -> dict[str, Any]:
        """Return a request for grasps, without the view itself."""
        request = {
            "task": "pick",
            "gripper_id": self.body.gripper_ids[side],
            "propose": True,
            "in_space": self.body.takes_poses,
            "max_grasps": 50,
            "seed": mix_seed(self.config.seed, track.number, encounter.tries + 1),
            "preset": self.body.preset,
            "neighbours": neighbour_points(track.seen, view),
            **self.config.thresholds.as_request(),
            "unknown": "grasp" if encounter.is_seen else "if_new",
        }
        return request | ({"object": track.object_iri} if track.object_iri else {})

    def _grasp(self, trial: _Try, plan: PlannedGrasp, grasp: dict[str, Any]) -> None:
        """Execute a planned grasp, judge it and report."""
        track, encounter, seconds = trial.track, trial.encounter, trial.seconds
        self._tell(
            "grasping",
            {
                **_about(track, encounter),
                "attempt": trial.number,
                "source": grasp["source"],
                "doing": f"grasping {encounter.title}",
            },
        )
        began, started = time.time(), time.perf_counter()
        record, pictures = self.body.execute(plan)
        seconds["move"] = time.perf_counter() - started
        span = began, began + seconds["move"]
        if not record.kept:
            self._crowd.fail(track, grasp)
        outcome = outcome_message(
            record, trial.number, trial.answer, grasp, seconds, pictures, span
        )
        if record.reason != "not_judged":  # else the physics diverged: no fault of the grasp
            self._report(trial, grasp, outcome, record.end_effector)
        self._runs += 1
        held, lost = grasp.get("explanation", {}).get("graph", (0.0, 0.0))
        attempt = Attempt(
            trial.number, grasp["source"], grasp["id"], record.reason, record.held, record.placed,
            True, float(grasp.get("mean", 0.0)), seconds, tuple(phase for phase, _ in pictures),
            record.place_reason, (float(held), float(lost)), self._runs, record.evidence,
            str((trial.answer.get("alone") or {}).get("text", "")),
            str(trial.answer.get("first_offered", "")),
        )  # fmt: skip
        encounter.attempts.append(attempt)
        track.gone = record.placed
        track.released = record.held and record.judged_placed.answer == "unknown"
        track.may_lie_in_box = track.released and record.judged_placed.is_new_there
        track.finished = record.placed or encounter.tries >= self.config.max_attempts
        if record.placed:
            self._pushes.note_move()
        self._tell(
            "attempt",
            _about(track, encounter) | asdict(attempt) | {"doing": "looking for the next object"},
        )

    def _choose(
        self, track: TrackedObject, view: Perceived, answer: dict[str, Any], has_failed: bool
    ) -> tuple[dict[str, Any], GraspChoice]:
        """Choose a grasp; return the answer with those planned on the view, and the choice.

        For a thing that stands free these are planned if an attempt at it failed, or none of the
        graph's can be reached.
        """
        proposed = answer["grasps"]
        first_offered = proposed[0]["source"] if proposed else ""
        if has_failed:
            self._crowd.look_closer(track)
        while True:
            was_planned = self._crowd.has_grasps(track)
            grasps = self._crowd.merged(track, proposed, self.config.max_plans)
            planned = choose_grasp(
                self.body, track, view, grasps, self.config.max_plans, self.config.seed,
                self._tracker.remembered(track, view.objects),
            )  # fmt: skip
            if planned.plan is not None or was_planned or not self._crowd.look_closer(track):
                return {**answer, "grasps": grasps, "first_offered": first_offered}, planned

    def _push(
        self, track: TrackedObject, view: Perceived, side: str, has_grasp: bool = True
    ) -> bool:
        """Push a thing that cannot be grasped; tell whether that was done.

        What no hand closes on may be two things that are seen as one. A plan on the whole view
        would have cut them apart, so that this is for arms that take none.
        """
        seed = mix_seed(self.config.seed, track.number, self._runs)
        is_pair = not has_grasp and not self.body.takes_poses
        reason = self._pushes.push(track, view, side, seed, is_pair)
        if reason:
            about = _about(track, self._encounter(track, side))
            doing = f"pushing {about['title']}"
            self._tell("push", about | {"reason": reason, "doing": doing})
        return bool(reason)

    def _encounter(self, track: TrackedObject, side: str) -> Encounter:
        track.meet()
        if track.number not in self.encounters:
            self.encounters[track.number] = Encounter.at(track.number, side, track.seen.shape)
        return self.encounters[track.number]

    def _first_sight(
        self, encounter: Encounter, track: TrackedObject, answer: dict[str, Any]
    ) -> Encounter:
        """Note how the server recognised a new thing, or join it with one that was lost."""
        recognition = answer["recognition"]
        lost = self._tracker.lost(answer["object"]) if recognition["accepted"] else None
        if self._is_searching and not recognition["accepted"]:  # both sides had been clear
            lost = self._tracker.stray(track)
        if lost is not None:
            del self.encounters[track.number]
            self._tracker.join(lost, track)
            if track.number in self.encounters:
                return self.encounters[track.number]
            encounter.number = track.number  # it was seen before, but not tried yet
            self.encounters[track.number] = encounter
        matches = recognition["matches"]
        encounter.is_seen = True
        encounter.confidence = float(matches[0]["confidence"]) if matches else 0.0
        match = answer if recognition["accepted"] else self._fell_out(track, matches)
        if match is not None:
            encounter.recognised = track.object_iri = match["object"]
            encounter.label = match["label"]
        self._on_sight(encounter, track.seen)
        self._tell(
            "recognised",
            {
                **_about(track, encounter),
                "recognised": encounter.recognised,
                "label": encounter.label,
                "confidence": encounter.confidence,
                "doing": f"planning a grasp of {encounter.title}",
            },
        )
        return encounter

    def _fell_out(
        self, track: TrackedObject, matches: Sequence[Mapping[str, Any]]
    ) -> Mapping[str, Any] | None:
        """Return the match for what this robot put into a box and now meets on the table again.

        It was knocked out of there. Lying another way up, it shows a side that the graph has not
        seen, and resembles itself too little to be accepted; as a new object, it would be stored
        twice.
        """
        best = matches[0] if matches else None
        if best is None or best["confidence"] < _RESEMBLES:
            return None
        is_likely = best["confidence"] >= _LIKELY
        return best if self._tracker.fell_out(best["object"], track, is_likely) else None

    def _give_up(self, trial: _Try, planned: GraspChoice) -> None:
        """Report the object's view, and why none of its grasps can be reached."""
        trial.track.finished = True
        grasp, reason = planned.grasp, planned.reason
        source = "none" if grasp is None else str(grasp["source"])
        attempt = Attempt(trial.number, source, "", reason, False, False, False, 0.0, trial.seconds)
        trial.encounter.attempts.append(attempt)
        if grasp is not None:
            outcome = {
                "success": False,
                "placed": False,
                "reason": reason,
                "attempt_number": trial.number,
            }
            self._report(trial, grasp, outcome, self.body.gripper_ids[trial.encounter.side])
        about = _about(trial.track, trial.encounter)
        self._tell("attempt", about | asdict(attempt) | {"doing": "looking on"})

    def _report(
        self, trial: _Try, grasp: dict[str, Any], outcome: dict[str, Any], gripper_id: str
    ) -> None:
        """Report the outcome, together with the view unless the graph knows object and grasp."""
        started = time.perf_counter()
        track, encounter, task_id = trial.track, trial.encounter, trial.answer["task_id"]
        common = {"gripper_id": gripper_id, "task": "pick"}
        is_certain = encounter.recognised and encounter.confidence >= _CONFIDENT
        # A view of two things as one is a view of neither, and would mislead other robots.
        is_known = bool(is_certain) or track.has_grown
        if track.object_iri and is_known and "tool_pose" not in grasp:
            self.server.report_outcome(
                task_id=task_id, object=track.object_iri, grasp=grasp, outcome=outcome, **common
            )
        else:
            item = {**trial.observation, **common, "grasp": grasp, "outcome": outcome,
                    "task_id": task_id}  # fmt: skip
            if track.object_iri:
                item["object"] = track.object_iri
            elif encounter.name:
                item["name"] = encounter.name
            stored = self.server.insert_object(objects=[item])
            track.object_iri = stored["objects"][0]["object"]
        encounter.object_iri = track.object_iri
        encounter.seconds["report"] = (
            encounter.seconds.get("report", 0.0) + time.perf_counter() - started
        )


def _about(track: TrackedObject, encounter: Encounter) -> dict[str, Any]:
    """Return which object an event is about."""
    return {"object": track.number, "title": encounter.title}
