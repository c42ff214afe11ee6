"""End effectors that robots registered, by name."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from grasp.spatial.gripper import ParallelGripper
from rtask.errors import UnknownTermError, nearest
from rtask.rdf.namespaces import PREFIXES, RT, local_name
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore

__all__ = ["GripperCatalogue", "KnownGripper"]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class KnownGripper:
    """An end effector in the graph."""

    iri: NamedNode
    robot: NamedNode
    robot_name: str
    gripper: ParallelGripper
    kind: str
    camera: NamedNode | None = None
    max_force: float | None = None
    """Largest closing force, N; None if the robot did not state it."""


class GripperCatalogue:
    """Cache of end effectors by name, refreshed when a robot changes."""

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._known: list[KnownGripper] | None = None

    def forget_if_changed(self, change: Change) -> None:
        """Drop the cache after a commit about robots."""
        telling = {RT.hasEndEffector, RT.hasSensor, RT.gripperType, RT.minOpening, RT.maxOpening,
                   RT.jawWidth, RT.fingerLength, RT.maxPayload, RT.maxForce}  # fmt: skip
        if any(quad.predicate in telling for quad in (*change.added, *change.removed)):
            with self._lock:
                self._known = None

    def all(self) -> list[KnownGripper]:
        """Return every end effector, in the order of their IRIs."""
        with self._lock:
            if self._known is None:
                self._known = _read_grippers(self._kb)
            return self._known

    def forces(self) -> dict[str, float]:
        """Return the largest closing force, N, of each type of gripper whose force is known."""
        found: dict[str, float] = {}
        for one in self.all():
            if one.max_force is not None:
                kind = one.gripper.gripper_type
                found[kind] = max(one.max_force, found.get(kind, 0.0))
        return found

    def find(self, gripper_id: str | None, agent: str | None) -> KnownGripper:
        """Return the end effector that a message names.

        Parameters
        ----------
        gripper_id
            IRI or name; None = the only gripper of the asking robot. An outcome is never credited
            to another robot's gripper, so a robot without a gripper must name one.
        agent
            The asking robot, whose grippers come first if several robots use a name.

        Raises
        ------
        UnknownTermError
            The message suggests the nearest name.
        """
        known = self.all()
        own = [g for g in known if g.robot_name == agent]
        if gripper_id is None:
            if len(own) == 1:
                return own[0]
            said = f"{agent} has {len(own)} grippers" if agent else "the caller has no name"
            raise UnknownTermError(f"gripper_id is missing, and {said}; known: {_listed(known)}")
        for g in (*own, *known):
            if gripper_id in (g.iri.value, g.gripper.name):
                return g
        names = sorted({g.gripper.name for g in known})
        hint = nearest(gripper_id, names) or f"; known: {_listed(known)}"
        raise UnknownTermError(f"unknown gripper {gripper_id!r}{hint}", did_you_mean=names[:3])


def _listed(known: list[KnownGripper]) -> str:
    return ", ".join(sorted({g.gripper.name for g in known})) or "none yet"


_GRIPPERS = f"""{PREFIXES}
SELECT ?part ?robot ?robot_name ?name ?type ?kind ?low ?high ?jaw ?finger ?payload ?force
  (MIN(?sensor) AS ?camera) WHERE {{
  ?robot rt:hasEndEffector ?part ; rt:name ?robot_name .
  ?part rt:name ?name ; rt:gripperType ?type ; rt:maxOpening ?high
  OPTIONAL {{ ?part a ?kind FILTER(?kind IN (rt:Hand, rt:ParallelJawGripper)) }}
  OPTIONAL {{ ?part rt:minOpening ?low }} OPTIONAL {{ ?part rt:jawWidth ?jaw }}
  OPTIONAL {{ ?part rt:fingerLength ?finger }} OPTIONAL {{ ?part rt:maxPayload ?payload }}
  OPTIONAL {{ ?part rt:maxForce ?force }}
  OPTIONAL {{ ?robot rt:hasSensor ?sensor }}
}} GROUP BY ?part ?robot ?robot_name ?name ?type ?kind ?low ?high ?jaw ?finger ?payload ?force"""


def _read_grippers(kb: GraphCore) -> list[KnownGripper]:
    found: dict[str, KnownGripper] = {}
    for row in kb.select(_GRIPPERS):
        given = {name: value for name, value in row.to_dict().items() if value is not None}
        part, robot, camera = row["part"], row["robot"], row["camera"]
        if not isinstance(part, NamedNode) or not isinstance(robot, NamedNode):
            continue
        kind = local_name(str(given.get("kind", "Hand")))
        try:
            gripper = ParallelGripper(
                name=str(given["name"]),
                gripper_type=str(given["type"]),
                min_opening=float(str(given.get("low", 0.0))),
                max_opening=float(str(given["high"])),
                symmetric=kind != "Hand",
                finger_width=float(str(given.get("jaw", ParallelGripper.finger_width))),
                finger_length=float(str(given.get("finger", ParallelGripper.finger_length))),
                max_payload=float(str(given.get("payload", ParallelGripper.max_payload))),
            )
        except ValueError as error:
            # One invalid gripper must not prevent the others from being used.
            log.warning("%s is left out: %s", part.value, error)
            continue
        known = KnownGripper(
            part, robot, str(given["robot_name"]), gripper, kind,
            camera if isinstance(camera, NamedNode) else None,
            float(str(given["force"])) if "force" in given else None,
        )  # fmt: skip
        found.setdefault(part.value, known)
    return [found[key] for key in sorted(found)]
