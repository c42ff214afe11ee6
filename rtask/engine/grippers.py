"""End effectors that robots registered, by name."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from grasp.spatial.gripper import EndEffector, ParallelGripper
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import ThreeFingerHand
from rtask.errors import ForbiddenError, UnknownTermError, nearest
from rtask.rdf.namespaces import PREFIXES, RT, local_name
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore

__all__ = ["GripperCatalogue", "StoredGripper", "hand_of", "jaws_modelled", "with_friction"]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StoredGripper:
    """An end effector in the graph."""

    iri: NamedNode
    robot: NamedNode
    robot_name: str
    gripper: EndEffector
    kind: str
    camera: NamedNode | None = None
    max_force: float | None = None
    """Largest closing force, N; None if the robot did not state it."""


class GripperCatalogue:
    """Cache of end effectors by name, refreshed when a robot changes."""

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._cached: list[StoredGripper] | None = None

    def forget_if_changed(self, change: Change) -> None:
        """Drop the cache after a commit about robots."""
        telling = {RT.hasEndEffector, RT.hasSensor, RT.gripperType, RT.minOpening, RT.maxOpening,
                   RT.jawWidth, RT.fingerLength, RT.maxPayload, RT.maxForce, RT.lipRadius,
                   RT.lipCompliance, RT.vacuumPressure}  # fmt: skip
        if any(quad.predicate in telling for quad in (*change.added, *change.removed)):
            with self._lock:
                self._cached = None

    def all(self) -> list[StoredGripper]:
        """Return every end effector, in the order of their IRIs."""
        with self._lock:
            if self._cached is None:
                self._cached = _read_grippers(self._kb)
            return self._cached

    def forces(self) -> dict[str, float]:
        """Return the largest closing force, N, of each type of gripper whose force is known."""
        forces: dict[str, float] = {}
        for stored in self.all():
            if stored.max_force is not None:
                kind = stored.gripper.gripper_type
                forces[kind] = max(stored.max_force, forces.get(kind, 0.0))
        return forces

    def find(
        self, gripper_id: str | None, access: Access, *, is_acting: bool = False
    ) -> StoredGripper:
        """Return the end effector that a message names.

        Parameters
        ----------
        gripper_id
            IRI or name; None = the only gripper of the asking robot. An outcome is never credited
            to another robot's gripper, so a robot without a gripper must name one.
        access
            Rights of the caller. A robot's token names its own grippers only; other callers may
            ask about those of any robot, by IRI where several use a name.
        is_acting
            Whether the message says that the gripper has done something. A person with a token
            then names none: the robot reports itself, and a person judges what it reported.

        Raises
        ------
        UnknownTermError
            The message suggests the nearest name.
        ForbiddenError
            It belongs to another robot than the one that calls.
        """
        grippers = self.all()
        own = [gripper for gripper in grippers if gripper.robot_name == access.agent]
        if gripper_id is None:
            if len(own) == 1:
                return own[0]
            agent = access.agent
            words = f"{agent} has {len(own)} grippers" if agent else "the caller has no name"
            raise UnknownTermError(
                f"gripper_id is missing, and {words}; known: {_listed(grippers)}"
            )
        fitting = [
            gripper
            for gripper in grippers
            if gripper_id in (gripper.iri.value, gripper.gripper.name)
        ]
        chosen = next((gripper for gripper in own if gripper in fitting), None)
        if chosen is not None:
            return chosen
        if fitting and (access.role == "robot" or (is_acting and access.agent is not None)):
            others = ", ".join(
                f"{gripper.iri.value} of {gripper.robot_name}" for gripper in fitting[:3]
            )
            yours = ", ".join(gripper.iri.value for gripper in own) or "none: register_robot first"
            raise ForbiddenError(
                f"gripper_id: the token belongs to {access.agent!r}, and {gripper_id!r} is "
                f"{others}; its own: {yours}",
                field="gripper_id",
            )
        if fitting:
            return fitting[0]
        names = sorted({gripper.gripper.name for gripper in grippers})
        hint = nearest(gripper_id, names) or f"; known: {_listed(grippers)}"
        raise UnknownTermError(f"unknown gripper {gripper_id!r}{hint}", did_you_mean=names[:3])


def _listed(grippers: list[StoredGripper]) -> str:
    return ", ".join(sorted({g.gripper.name for g in grippers})) or "none yet"


_SIZES = {
    "min_opening": "minOpening", "max_opening": "maxOpening", "jaw_width": "jawWidth",
    "finger_length": "fingerLength", "max_payload": "maxPayload", "max_force": "maxForce",
    "lip_radius": "lipRadius", "lip_compliance": "lipCompliance", "pressure": "vacuumPressure",
    "flange_radius": "flangeRadius",
}  # fmt: skip
"""Property of the graph for each size of a hand, as :func:`hand_of` takes them."""

_KINDS = "rt:Hand, rt:ParallelJawGripper, rt:SuctionCup, rt:ThreeFingerHand"
_COLUMNS = " ".join(f"?{name}" for name in _SIZES)
_GRIPPERS = f"""{PREFIXES}
SELECT ?part ?robot ?robot_name ?name ?type ?kind {_COLUMNS} (MIN(?sensor) AS ?camera) WHERE {{
  ?robot rt:hasEndEffector ?part ; rt:name ?robot_name .
  ?part rt:name ?name ; rt:gripperType ?type
  OPTIONAL {{ ?part a ?kind FILTER(?kind IN ({_KINDS})) }}
  {" ".join(f"OPTIONAL {{ ?part rt:{term} ?{name} }}" for name, term in _SIZES.items())}
  OPTIONAL {{ ?robot rt:hasSensor ?sensor }}
}} GROUP BY ?part ?robot ?robot_name ?name ?type ?kind {_COLUMNS}"""


def hand_of(name: str, gripper_type: str, kind: str, sizes: Mapping[str, float]) -> EndEffector:
    """Return an end effector from what a robot states about it.

    Parameters
    ----------
    kind
        Its class in the ontology: ``Hand``, ``ParallelJawGripper``, ``SuctionCup`` or
        ``ThreeFingerHand``.
    sizes
        By the names of a registration, m, N, kg and Pa; those left out are as usual.

    Raises
    ------
    ValueError
        The sizes are missing or contradict each other.

    Examples
    --------
    >>> hand_of("vacuum", "cup_30", "SuctionCup", {"lip_radius": 0.015}).contact_kind
    'suction'
    >>> sizes = {"lip_radius": 0.015, "flange_radius": 0.044}
    >>> [round(side, 3) for side in hand_of("vacuum", "cup_30", "SuctionCup", sizes).wrist]
    [0.078, 0.078, 0.05]
    """
    if kind == "SuctionCup":
        named = _named(
            sizes, radius="lip_radius", compliance="lip_compliance", pressure="pressure",
            max_payload="max_payload", length="finger_length",
        )  # fmt: skip
        if "radius" not in named:
            raise ValueError(f"suction cup {name!r}: lip_radius is missing")
        cup = SuctionCup(name, gripper_type=gripper_type, **named)
        return cup.flanged(sizes["flange_radius"]) if "flange_radius" in sizes else cup
    named = _named(sizes, min_opening="min_opening", max_opening="max_opening",
                   finger_width="jaw_width", finger_length="finger_length",
                   max_payload="max_payload")  # fmt: skip
    if "max_opening" not in named:
        raise ValueError(f"gripper {name!r}: max_opening is missing")
    if kind == "ThreeFingerHand":
        if "max_force" in sizes:
            named["max_force"] = sizes["max_force"] / 3
        return ThreeFingerHand(name, gripper_type=gripper_type, **named)
    named.setdefault("min_opening", 0.0)
    return ParallelGripper(name, gripper_type, symmetric=kind != "Hand", **named)


def _named(sizes: Mapping[str, float], **fields: str) -> dict[str, Any]:
    return {field: sizes[name] for field, name in fields.items() if name in sizes}


def jaws_modelled(hand: EndEffector) -> EndEffector:
    """Return a hand with the whole shape of its type, where that is known of jaws."""
    return hand.modelled() if isinstance(hand, ParallelGripper) else hand


def with_friction(hand: EndEffector, friction: float) -> EndEffector:
    """Return a hand with another Coulomb coefficient."""
    assert isinstance(hand, ParallelGripper | SuctionCup | ThreeFingerHand)
    return replace(hand, friction=friction)


def _read_grippers(kb: GraphCore) -> list[StoredGripper]:
    grippers: dict[str, StoredGripper] = {}
    for row in kb.select(_GRIPPERS):
        given = {name: value for name, value in row.to_dict().items() if value is not None}
        part, robot, camera = row["part"], row["robot"], row["camera"]
        if not isinstance(part, NamedNode) or not isinstance(robot, NamedNode):
            continue
        kind = local_name(str(given.get("kind", "Hand")))
        sizes = {name: float(str(given[name])) for name in _SIZES if name in given}
        try:
            gripper = hand_of(str(given["name"]), str(given["type"]), kind, sizes)
        except ValueError as error:
            # One invalid gripper must not prevent the others from being used.
            log.warning("%s is left out: %s", part.value, error)
            continue
        stored_gripper = StoredGripper(
            part, robot, str(given["robot_name"]), gripper, kind,
            camera if isinstance(camera, NamedNode) else None, sizes.get("max_force"),
        )  # fmt: skip
        grippers.setdefault(part.value, stored_gripper)
    return [grippers[key] for key in sorted(grippers)]
