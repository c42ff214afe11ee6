"""Robots of a day: they look, take, put and report by the public operations, and know no truth."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ontology
from grasp.messages import pose_message
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from simulate.study.day.lab import BOXES, TABLES, Item, Lab, Place, distance

__all__ = ["BASE", "SIGMA_M", "Robot", "ask", "box_iri", "place_rows"]

BASE = "https://example.org/lab/"
SIGMA_M = 0.004
"""Standard deviation per axis of what a robot sees, m."""
_CALIBRATION_M = 0.002
_FRAMES_A_LOOK = 3
_DETECTED = 0.95
_MATCHED_M = 0.05
_COVER_M = 0.08
_HAND_S = 12.0
_HEAD = f"{PREFIXES}PREFIX rtf: <{ontology.FUNCTIONS}>\n"


@dataclass
class Robot:
    """A robot at a table.

    Parameters
    ----------
    name, table
        Its name, and the table at which it stands.
    errors
        Counts of what the graph took for another thing than it was, by the true name.
    identified
        True thing of each IRI that the graph gave, for judging only.
    """

    name: str
    engine: Engine
    lab: Lab
    rng: np.random.Generator
    table: str
    identified: dict[str, Item]
    errors: list[str] = field(default_factory=list)
    hand: str = ""

    def call(self, operation: str, **args: Any) -> Any:
        """Call an operation as this robot."""
        return self.engine.call(operation, args, Access(self.name, "robot"))

    def register(self, time_s: float) -> None:
        """Enter the lab: register, and state where the robot stands."""
        hand = {
            "name": "hand", "gripper_type": "nao_hand", "kind": "Hand", "min_opening": 0.0,
            "max_opening": 0.08, "jaw_width": 0.02, "finger_length": 0.05, "max_force": 3.0,
            "max_payload": 0.5, "parent_link": "wrist", "planning_group": "arm",
        }  # fmt: skip
        self.call("register_robot", name=self.name, model=self.name.partition("-")[0],
                  simulated=True, end_effectors=[hand], frames=["base"])  # fmt: skip
        hands = {grip.iri.value for grip in self.engine.grippers.all()
                 if grip.robot_name == self.name}  # fmt: skip
        (self.hand,) = hands
        self.stand_at(self.table, time_s)

    def stand_at(self, table: str, time_s: float) -> None:
        """Walk to a table and state where the base is, as well as the robot can measure that."""
        self.table = table
        centre = TABLES[table]
        self._map_from_base = _pose(centre[0], centre[1] - 0.7, np.pi / 2)
        dx, dy = self.rng.normal(0.0, _CALIBRATION_M, 2)
        stated = self._map_from_base @ _pose(float(dx), float(dy), 0.0)
        self.call("state_frame", frame="base", parent="map", pose=pose_message(stated),
                  sigma=_CALIBRATION_M, stamp=time_s)  # fmt: skip

    def look(self, time_s: float) -> list[tuple[str, Item]]:
        """Look at the table and report; return the IRIs of what was seen, with the true things."""
        seen = [item for item in self.lab.on(self.table) if self._detects(item, time_s)]
        spots = [self._measured(item) for item in seen]
        gone = self._missing(list(zip(seen, spots, strict=True)), time_s)
        items = self._report(list(zip(seen, spots, strict=True)), time_s, gone=gone)
        return list(zip(items, seen, strict=True))

    def carry(self, item: Item, iri: str, target: Place, time_s: float, slips: bool) -> float:
        """Take a thing and put it somewhere, or let it slip; return when that was over."""
        for other in self.lab.neighbours(item, 0.2) if item.now.kind == "on" else ():
            if self.rng.random() < 0.2:
                self.lab.nudge(other, time_s)
        self.lab.move(item, Place("held", self.name, time_s, self.name))
        self._state(iri, time_s, place=self.hand)
        time_s += _HAND_S
        if slips:
            spot = self.lab.free_spot(self.table)
            self.lab.move(item, Place("on", self.table, time_s, self.name, spot))
            self._state(iri, time_s, lost=True)
        elif target.kind == "in":
            self.lab.move(item, Place("in", target.where, time_s, self.name))
            self._state(iri, time_s, place=box_iri(target.where), inside=True)
        else:
            self.lab.move(item, Place("on", self.table, time_s, self.name, target.spot))
            self._report([(item, self._measured(item))], time_s, item=iri)
        return time_s

    def boxed(self, time_s: float) -> list[str]:
        """Return the things that the graph says are in the box at this table."""
        box = next(box for box, table in BOXES.items() if table == self.table)
        rows = place_rows(self.engine, f"?thing rtf:inside <{box_iri(box)}>", time_s)
        return self._in_order(str(row["thing"]) for row in rows)

    def _in_order(self, exemplars: Iterable[str]) -> list[str]:
        """Return things in the order of the lab, since new IRIs are drawn with each run."""
        number = {id(item): k for k, item in enumerate(self.lab.items)}
        return sorted(exemplars, key=lambda iri: number[id(self.identified[iri])])

    def _state(self, iri: str, time_s: float, **args: Any) -> None:
        self.call("state_place", **{"thing": iri, "stamp": time_s, **args})

    def _detects(self, item: Item, time_s: float) -> bool:
        if item.covered_until_s > time_s:
            return False
        return bool((self.rng.random(_FRAMES_A_LOOK) < _DETECTED).any())

    def _measured(self, item: Item) -> NDArray[np.float64]:
        """Return the pose of a thing in the robot's base, as the robot measures it."""
        x, y = item.now.spot
        dx, dy = self.rng.normal(0.0, SIGMA_M, 2)
        there = _pose(x + float(dx), y + float(dy), 0.0)
        return np.asarray(np.linalg.inv(self._map_from_base) @ there)

    def _missing(self, seen: list[tuple[Item, NDArray[np.float64]]], time_s: float) -> list[str]:
        """Return the things that should be in plain view on the table, and are not."""
        block = "?thing rtf:poseIn :frame ; rtf:x ?x ; rtf:y ?y"
        frame = f"{BASE}frame/{self.table}"
        rows = place_rows(self.engine, block.replace(":frame", f"<{frame}>"), time_s,
                          "?thing rt:exemplarOf/rt:objectId ?id")  # fmt: skip
        centre = TABLES[self.table]
        covers = [t.now.spot for t in self.lab.on(self.table) if t.covered_until_s > time_s]
        where: dict[int, list[tuple[float, float]]] = {}
        for item, pose in seen:
            x, y = (self._map_from_base @ pose)[:2, 3]
            where.setdefault(item.product, []).append((float(x), float(y)))
        missing = []
        for row in rows:
            x, y = float(row["x"]), float(row["y"])
            spot = centre[0] + x, centre[1] + y
            if abs(x) > 0.8 or abs(y) > 0.4 or _is_near(spot, covers, _COVER_M):
                continue
            product = int(str(row["id"]).removeprefix("lab/"))
            if not _is_near(spot, where.get(product, []), _MATCHED_M):
                missing.append(str(row["thing"]))
        return self._in_order(missing)

    def _report(
        self,
        seen: list[tuple[Item, NDArray[np.float64]]],
        time_s: float,
        gone: list[str] | None = None,
        item: str = "",
    ) -> list[str]:
        said: Mapping[str, str] = {"thing": item} if item else {}
        reports = [
            {"object": f"{BASE}object/{true.product}", "pose": pose_message(pose),
             "sigma": SIGMA_M, **said}
            for true, pose in seen
        ]  # fmt: skip
        answer = self.call("report_sightings", frame="base", seen=reports, gone=gone or [],
                           stamp=time_s)  # fmt: skip
        for iri, (true, _) in zip(answer["things"], seen, strict=True):
            if self.identified.setdefault(iri, true) is not true:
                self.errors.append(true.name)
        return list(answer["things"])


def ask(engine: Engine, operation: str, **args: Any) -> Any:
    """Call an operation as somebody who may read only."""
    return engine.call(operation, args, Access("eve", "reader"))


def place_rows(engine: Engine, block: str, time_s: float, rest: str = "") -> list[dict[str, Any]]:
    """Return the rows of a question about places in SPARQL at a time."""
    moment = dt.datetime.fromtimestamp(time_s, dt.UTC).isoformat()
    text = (f'{_HEAD}SELECT * {{ SERVICE <urn:rtask:place> {{ {block} ; '
            f'rtf:at "{moment}"^^xsd:dateTime }} {rest} }}')  # fmt: skip
    return [row.to_dict() for row in engine.context.kb.select(text)]


def box_iri(name: str) -> str:
    """Return the IRI of a box."""
    return f"{BASE}place/{name.replace(' ', '-')}"


def _is_near(spot: tuple[float, float], others: list[tuple[float, float]], most: float) -> bool:
    return any(distance(spot, other) <= most for other in others)


def _pose(x: float, y: float, yaw: float) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:2, 3] = x, y
    return pose
