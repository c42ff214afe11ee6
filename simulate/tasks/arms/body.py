"""A whole robot as a carrier of planned tasks: it looks, recognises, grasps, and puts things down.

What it says of a step it has measured: with its camera, and with its fingers. It knows nothing of
the truth of the physics. Grasps come from the graph, those that held before first.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np

from features.geometry import FloatArray
from features.perception import Seen, neighbour_points
from rtask.rdf.namespaces import PREFIXES
from simulate.agent.grasp_choice import GraspChoice, choose_grasp
from simulate.agent.messages import observation_message, outcome_message
from simulate.agent.second_look import View
from simulate.agent.tracking import TrackedObject
from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.judgement import CLOSED_ON_SOMETHING, Judgement
from simulate.motion.collision import Obstacle
from simulate.tasks.arms.bench import OTHER_ROBOT, Station
from simulate.tasks.arms.bystanders import Bystanders
from simulate.tasks.arms.resuming import is_away, resumed
from simulate.tasks.arms.sightings import Sighting, disambiguated, find_by_size, size_of
from simulate.tasks.arms.station_body import RobotAtBench
from simulate.tasks.arms.visibility import is_seen_through
from simulate.tasks.body import Attempted, Deed
from simulate.tasks.executor import Graph
from simulate.world.seeds import mix_seed

__all__ = ["ArmBody"]

_MAX_PLANS = 10
_TURNED = 2
"""Spots at which a thing is turned for the next robot, and directions tried there: each is work."""
_RESEMBLES = 0.35
"""Half of what the graph accepts: enough to know again what is expected to be there."""


@dataclass(frozen=True)
class _Held:
    """What a hand holds, and the attempt that is to be ended by putting it down."""

    item: str
    run: AttemptRun


class ArmBody:
    """A robot at a bench; a :class:`simulate.tasks.body.TaskBody`.

    Parameters
    ----------
    station
        Where it stands.
    graph
        A client in its name.
    hands
        Name of the arm of each hand, by IRI.
    places
        Name of the area of each place, by IRI, that it gets to.
    seed
        Of its choices.
    others
        Name of the area of each other place, by IRI; it looks at those that its cameras show.
    """

    def __init__(
        self,
        station: Station,
        graph: Graph,
        hands: Mapping[str, str],
        places: Mapping[str, str],
        seed: int = 0,
        others: Mapping[str, str] | None = None,
    ) -> None:
        self.robot = RobotAtBench(station)
        self.graph, self._arms, self._places, self._seed = graph, hands, places, seed
        self._held: dict[str, _Held] = {}
        self._unmoved = set(hands)
        """Hands that this program has neither moved nor felt yet, as another one left them."""
        self._products: dict[str, str] = {}
        self._sizes: dict[str, list[float]] = {}
        self._shown = {**places, **{iri: name for iri, name in (others or {}).items()
                                    if iri not in places and self.robot.shows(name)}}  # fmt: skip
        self._used: dict[tuple[str, str], list[tuple[float, float]]] = {}
        self._seen: dict[tuple[str, int], tuple[tuple[float, int], list[Sighting], View]] = {}
        self._asked = 0
        self._tried: Counter[str] = Counter()
        layout = station.bench.layout
        self._tables = [at for at, name in places.items() if not layout.area(name).is_box]
        self._bystanders = Bystanders(self, graph, self._tables)

    def restarted(self) -> ArmBody:
        """Return the robot as another program finds it that knows nothing of what this one did."""
        return ArmBody(self.robot.station, self.graph, self._arms, self._places, self._seed,
                       self._shown)  # fmt: skip

    @property
    def hands(self) -> Mapping[str, str]:
        """Gripper id of each hand: its IRI, as robots of one kind have hands of one name."""
        return {hand: hand for hand in self._arms}

    @property
    def places(self) -> Mapping[str, str]:
        """Name of the area of each place that it gets to, by IRI."""
        return self._places

    @property
    def physics(self) -> Literal["faithful", "fast"]:
        """Preset of the physics."""
        return "faithful" if self.robot.preset == "faithful" else "fast"

    def sees(self, item: str, place: str) -> bool:
        """Look whether a thing is in an area, from any viewpoint, or feel it in a hand."""
        if place in self._arms:
            return self._feels(item, place)
        return place in self._places and self.is_seen(item, place)

    def find(self, item: str) -> str | None:
        """Look for a thing in all areas within reach, and feel for it in the hands.

        An arm that has lost what it held is out of the way then. What is not seen at once is looked
        for from elsewhere, and where only the cameras get to.
        """
        self._release_lost()
        felt = next((hand for hand in self._arms if self._feels(item, hand)), None)
        # One look at each area first: to look from everywhere takes several times as long.
        at_once = (at for at in self._places if self._sight(item, at) is not None)
        return felt or next(at_once, None) or self.place_seen(item) or self._covering(item)

    def _covering(self, item: str) -> str | None:
        """Return the box that the graph has a thing in, if it may lie under something else there.

        Not seen in a box with other things is not gone: to say so would lose it for everybody.
        """
        layout = self.robot.station.bench.layout
        for place, name in self._places.items():
            if layout.area(name).is_box:
                there = {str(row["thing"]) for row in self.graph.query(_CONTENTS % place)}
                if item in there and len(there) > 1:
                    return place
        return None

    def _release_lost(self) -> None:
        for hand, held in list(self._held.items()):
            if not self._feels(held.item, hand):
                self._let_go(hand)

    def is_seen(self, item: str, place: str) -> bool:
        """Look whether a thing is in an area, from any viewpoint."""
        return self._sight_anew(item, place) is not None

    def place_seen(self, item: str) -> str | None:
        """Look for a thing in all areas that the cameras show, from all viewpoints."""
        return next((at for at in self._shown if self.is_seen(item, at)), None)

    def count_seen(self, item: str, place: str) -> int:
        """Return how many of the product of a thing are seen in an area, at most from one view."""
        product, views = self.product(item), range(len(self.robot.viewpoints(self._shown[place])))
        return max(sum(s.object == product for s in self.look(place, view)) for view in views)

    def spots(self, item: str, place: str) -> list[FloatArray]:
        """Return the surfaces (n, 3), m, base frame, of what is seen of a product in an area.

        From the view that shows most of them; of a thing alone also if it is known by its size.
        """
        product, views = self.product(item), range(len(self.robot.viewpoints(self._shown[place])))
        of_view = [[s for s in self.look(place, view) if s.object == product] for view in views]
        best = max(of_view, key=len)
        fallen = self._sight_anew(item, place) if not best else None
        return [s.seen.points for s in (best if fallen is None else [fallen])]

    def is_empty(self, spot: FloatArray, place: str) -> bool:
        """Look whether there is nothing any more where a surface of an area was seen."""
        for number in range(len(self.robot.viewpoints(self._shown[place]))):
            self.look(place, number)
            view = self._seen[place, number][2]
            if is_seen_through(spot, view.frame, view.base_from_camera):
                return True
        return False

    def holds(self, item: str) -> bool:
        """Return whether a hand has a thing, by what this program knows."""
        return any(held.item == item for held in self._held.values())

    def displaced(self) -> Mapping[str, str | None]:
        """Look for what stood around the last action; return what is no longer where it was."""
        # An arm that lost what it held goes home first: on its way it may push something, too.
        self._release_lost()
        return self._bystanders.displaced()

    def picture(self) -> bytes | None:
        """Return what the camera sees as JPEG."""
        frame, _ = self.robot.look("right")
        if frame.rgb is None:
            return None
        done, data = cv2.imencode(".jpg", np.ascontiguousarray(frame.rgb[..., ::-1]))
        return data.tobytes() if done else None

    def look(self, place: str, number: int = 0) -> list[Sighting]:
        """Look at an area; return what is in it, recognised by the graph.

        Parameters
        ----------
        number
            Which of the viewpoints, the best first.
        """
        moment, key = self.robot.world.moment, (place, number)
        if key not in self._seen or self._seen[key][0] != moment:
            view, inside = self.robot.look_at(self._shown[place], number)
            sightings = disambiguated([self._recognise(seen, view) for seen in inside])
            self._seen[key] = moment, sightings, view
        return self._seen[key][1]

    def look_anew(self) -> None:
        """Forget what was seen: the graph may know more of it now."""
        self._seen.clear()

    def pick(self, item: str, place: str, hand: str) -> Deed:
        """Look, choose a grasp with the graph, plan, grasp and lift."""
        # From any viewpoint, as find() looks: else what one view hides is planned for ever anew.
        sighting = self._sight_anew(item, place)
        self._take_over(item, hand)
        if hand in self._held:
            return Deed(False, "hand_full", was_tried=False)
        if sighting is None:
            return Deed(False, "not_seen", was_tried=False)
        seconds: dict[str, float] = {}
        answer, track = self._ask(sighting, item, hand, seconds)
        started = time.perf_counter()
        planned = self._choose(answer, track, sighting, hand)
        seconds["plan"] = time.perf_counter() - started
        if planned.plan is None or planned.grasp is None:
            return self._unreachable(planned)
        self._bystanders.note(item)
        run = self.robot.executor.begin(planned.plan)
        began, started = time.time(), time.perf_counter()
        reason = run.grasp()
        span = began, began + time.perf_counter() - started
        # What becomes of the thing is the next step's: nothing was put down, so nothing arrived.
        record = replace(run.record, judged_placed=Judgement("unknown"))
        self._tried[item] += 1
        number = self._tried[item]
        outcome = outcome_message(record, number, answer, planned.grasp, seconds, [], span)
        if reason == "ok":
            self._held[hand] = _Held(item, run)
            self.robot.is_holding = True
        attempted = Attempted(planned.grasp, outcome, sighting.observation)
        return Deed(reason == "ok", reason, record.duration_s, record.lifted_m, attempted)

    def put(self, item: str, place: str, hand: str) -> Deed:
        """Put a held thing into a box or onto a free spot of an area, and look whether it is."""
        held = self._held.get(hand)
        if held is None or held.item != item or not self._feels(item, hand):
            self._let_go(hand)
            return Deed(False, "slip_transport")
        area, run = self._places[place], held.run
        self._bystanders.note(item, place)
        # Where the others were when the grasp was planned, they may be no longer.
        still = [obstacle for obstacle in run.plan.obstacles
                 if not isinstance(obstacle, Obstacle) or obstacle.name != OTHER_ROBOT]  # fmt: skip
        run.plan = replace(run.plan, obstacles=(*still, *self.robot.station.others()))
        box = self.robot.station.boxes.get(area)
        before = run.drive.elapsed_s
        reason = run.place_in_box(box) if box is not None else self._put_on_table(run, area, item)
        self._forget(hand)
        if reason != "ok" and self._has_arrived(item, place, run):
            reason = "ok"
        elif reason == "ok" and self._lies_elsewhere(item, place):
            reason = "drop_outside"
        return Deed(reason == "ok", reason, run.drive.elapsed_s - before)

    def _put_on_table(self, run: AttemptRun, area: str, item: str) -> str:
        """Put what is held onto a free spot of an area, around what stands there."""
        view, _ = self.robot.look_at(area)
        request = run.plan.request
        size = max(request.length, request.width)
        used = self._used.setdefault((item, area), [])
        spots = self.robot.free_spots(area, size, view.perceived, request, tuple(used))
        if not spots:
            run.put_back()
            return "place_plan"
        used.append(spots[0])
        there = self.robot.beside(view.perceived, request)
        run.plan = replace(run.plan, obstacles=(*run.plan.obstacles, *there))
        turned = () if request.round else spots[:_TURNED]
        closings = tuple(
            self.robot.ways(area, spot, request, there)[:_TURNED] if spot in turned else ()
            for spot in spots
        )
        return run.place_within(*self.robot.station.ranges(area), spots, closings)

    def give(self, item: str, hand: str, target: str) -> Deed:
        """Say that hands do not meet here: things change hands at places."""
        return Deed(False, "place_plan")

    def _has_arrived(self, item: str, place: str, run: AttemptRun) -> bool:
        """Look for a thing of which it is not certain that it arrived.

        It did if it is seen there, or if something new is there and it is nowhere on the table.
        """
        if self._sight(item, place) is not None or self._sight_anew(item, place) is not None:
            return True
        is_gone = all(self._sight(item, at) is None for at in self._tables)
        return run.placed.is_new_there and run.placed.answer == "unknown" and is_gone

    def _lies_elsewhere(self, item: str, place: str) -> bool:
        """Look whether a thing that seemed to arrive is seen on another part of the table.

        That something new is at the place does not tell what it is: another thing may have been
        pushed there. A look tells products apart, not things: those of the same product that stood
        there before are no news.
        """
        product = self.product(item)
        equal = Counter(at for other, at in self._bystanders.areas_before.items()
                        if other != item and self.product(other) == product)  # fmt: skip
        seen = {at: sum(s.object == product for s in self.look(at)) for at in self._tables}
        elsewhere = sum(seen[at] - equal[at] for at in self._tables if at != place)
        return elsewhere > 0 and seen.get(place, 0) <= equal[place]

    def _take_over(self, item: str, hand: str) -> None:
        """Find out whether a hand holds what another program of this robot picked up.

        It is what the graph has in the hand; where it has nothing there, what is asked about.
        """
        arm = self._arms[hand]
        if hand not in self._unmoved:
            return
        self._unmoved.discard(hand)
        if not is_away(self.robot, arm):
            return
        rows = self.graph.query(_IN_HAND % hand)
        held = str(rows[0]["thing"]) if rows else item
        run = resumed(self.robot, arm, self._seed, self._extents(held))
        if run is not None:
            self._held[hand] = _Held(held, run)
            self.robot.is_holding = True

    def _feels(self, item: str, hand: str) -> bool:
        self._take_over(item, hand)
        held = self._held.get(hand)
        if held is None or held.item != item:
            return False
        return self.robot.robot.finger_opening(self._arms[hand]) > CLOSED_ON_SOMETHING

    def _let_go(self, hand: str) -> None:
        """Bring an arm home that has lost what it held."""
        held = self._held.get(hand)
        if held is not None:
            held.run.put_back()
            self._forget(hand)

    def _forget(self, hand: str) -> None:
        self._held.pop(hand, None)
        self.robot.is_holding = bool(self._held)

    def _sight_anew(self, item: str, place: str) -> Sighting | None:
        """Return the thing if it is seen in an area from any viewpoint."""
        numbers = range(len(self.robot.viewpoints(self._shown[place])))
        seen = (self._sight(item, place, number) for number in numbers)
        return next((sighting for sighting in seen if sighting is not None), None)

    def _sight(self, item: str, place: str, number: int = 0) -> Sighting | None:
        """Return the thing if it is seen in an area.

        What has fallen over, or was put down by a person, shows a side that the graph may not know:
        then it is the only thing that is nothing else, if it has the size of it.
        """
        product, there = self.product(item), self.look(place, number)
        sighting = next((seen for seen in there if seen.object == product), None)
        size = self._size(item)
        if sighting is None and size and any(not seen.object for seen in there):
            sighting = find_by_size(there, size, self._missing(item, place, there))
        if sighting is not None:
            self._sizes[item] = size or size_of(sighting)
        return sighting

    def _size(self, item: str) -> list[float]:
        """Return the sizes of a thing as it was first seen by any robot; none if unknown."""
        if not self._sizes.get(item):
            self._sizes[item] = sorted(self._extents(item) or ())
        return self._sizes[item]

    def _extents(self, item: str) -> tuple[float, float, float] | None:
        """Return the extents (x, y, z), m, of a thing as the graph has it; None if unknown."""
        rows = self.graph.query(_SIZE % item)
        if not rows:
            return None
        x, y, z = (float(str(rows[0][name])) for name in "xyz")
        return x, y, z

    def _missing(self, item: str, place: str, there: list[Sighting]) -> list[list[float]]:
        """Return the sizes of other things that the graph has in an area, and a view does not."""
        shown = {seen.object for seen in there}
        others = (str(row["thing"]) for row in self.graph.query(_CONTENTS % place))
        missing = (other for other in others
                   if other != item and self.product(other) not in shown)  # fmt: skip
        return [size for other in missing if (size := self._size(other))]

    def product(self, item: str) -> str:
        """Return the IRI of the product of a thing; empty if the graph has none."""
        if item not in self._products:
            rows = self.graph.query(_PRODUCT % item)
            self._products[item] = str(rows[0]["product"]) if rows else ""
        return self._products[item]

    def _recognise(self, seen: Seen, view: View) -> Sighting:
        """Ask the graph what a thing is; it may be less sure of what was expected there anyway.

        Without the name of a frame, so that the graph does not take the look for news of where the
        thing is: that it stands on a place, and which of several it is, a mere pose does not say.
        """
        observation = observation_message(
            seen, view.perceived, view.base_from_camera, self.robot.base_frame
        )
        answer = self.graph.call(
            "recognise_for_grasp", gripper_id=next(iter(self.hands.values())),
            **_nowhere(observation),
        )  # fmt: skip
        recognition = answer["recognition"]
        matches = recognition["matches"]
        best = float(matches[0]["confidence"]) if matches else 0.0
        if recognition["accepted"]:
            return Sighting(seen, view, str(answer["object"]), observation, 1.0 + best)
        product = str(matches[0]["object"]) if best >= _RESEMBLES else ""
        return Sighting(seen, view, product, observation, best)

    def _ask(
        self, sighting: Sighting, item: str, hand: str, seconds: dict[str, float]
    ) -> tuple[dict[str, Any], TrackedObject]:
        """Ask the graph for grasps of a thing; return the answer and the thing as it is planned."""
        self._asked += 1
        track = TrackedObject(self._asked, sighting.seen, self.product(item))
        request = {
            "task": "pick",
            "gripper_id": self.hands[hand],
            "propose": True,
            "in_space": self.robot.takes_poses,
            "max_grasps": 50,
            "seed": mix_seed(self._seed, self._asked),
            "preset": self.robot.preset,
            "neighbours": neighbour_points(sighting.seen, sighting.view.perceived),
            "object": track.object_iri,
        }
        started = time.perf_counter()
        answer = self.graph.call("recognise_for_grasp", **request, **_nowhere(sighting.observation))
        seconds["ask"] = time.perf_counter() - started
        return answer, track

    def _choose(
        self, answer: Mapping[str, Any], track: TrackedObject, sighting: Sighting, hand: str
    ) -> GraspChoice:
        self.robot.arm = self._arms[hand]
        seed = mix_seed(self._seed, self._asked)
        perceived = sighting.view.perceived
        return choose_grasp(self.robot, track, perceived, answer["grasps"], _MAX_PLANS, seed)

    def _unreachable(self, planned: GraspChoice) -> Deed:
        """Say why nothing was tried."""
        if planned.grasp is None:
            return Deed(False, planned.reason, was_tried=False)
        outcome = {"success": False, "placed": False, "reason": planned.reason}
        return Deed(False, planned.reason, attempt=Attempted(planned.grasp, outcome))


def _nowhere(observation: Mapping[str, Any]) -> dict[str, Any]:
    """Return an observation without the name of its frame; its poses stay in the base frame."""
    return {name: value for name, value in observation.items() if name != "frame_id"}


_IN_HAND = f"""{PREFIXES}
SELECT ?thing WHERE {{ ?thing a rt:Exemplar ; rt:locatedOn <%s> }} LIMIT 1"""
_PRODUCT = f"""{PREFIXES}
SELECT ?product WHERE {{ <%s> rt:exemplarOf ?product . ?product rt:objectId ?id }} LIMIT 1"""
_SIZE = f"""{PREFIXES}
SELECT ?x ?y ?z WHERE {{
  <%s> rt:exemplarOf ?product . ?product rt:extentX ?x ; rt:extentY ?y ; rt:extentZ ?z }} LIMIT 1"""
_CONTENTS = f"""{PREFIXES}
SELECT DISTINCT ?thing WHERE {{ ?thing a rt:Exemplar ; rt:locatedOn <%s> }} ORDER BY ?thing"""
