"""Grasps offered for a task, and the reasons for their order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from grasp.learning.bandit import Choice
from grasp.learning.causes import Hidden
from grasp.spatial.candidate import Contacts, GraspCandidate
from grasp.spatial.planar import PlanarGrasp
from rtask.engine.names import tail
from rtask.engine.remembered import Remembered
from rtask.rdf.terms import iri

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition

__all__ = ["LOWERED", "MIN_EVIDENCE", "Decision", "Offer", "Option", "graph_against_geometry"]

MIN_EVIDENCE = 0.05
"""Evidence on a grasp, in outcomes, below which the graph is taken to know nothing of it."""

LOWERED = 0.95
"""Share of a grasp's quality below which attempts elsewhere on the object are said to lower it."""

_SAME_M, _SAME_RAD = 0.005, 0.17


@dataclass(frozen=True)
class Option:
    """A grasp that may be chosen.

    Parameters
    ----------
    id
        IRI of a remembered grasp, ``candidate:<k>`` of a proposed one.
    grasp
        In the robot's frame; z of a planar grasp is above the support.
    in_object
        (x, y, z, theta) in the object's frame.
    remembered
        The stored grasp, or None if it is proposed.
    choice
        The learner's assessment, added by :func:`choose`.
    sources
        Objects whose outcomes are evidence for it.
    quaternion
        Orientation (x, y, z, w) of a grasp in space in the object's frame, else None.
    contacts
        Of a cup or of three fingers in the gripper frame; None for jaws.
    cause
        What attempts say hides in the object that lowers its chance most, from and to in the
        object's frame, m; None if nothing does much.
    """

    id: str
    grasp: PlanarGrasp | GraspCandidate
    in_object: tuple[float, float, float, float]
    remembered: Remembered | None = None
    choice: Choice | None = None
    sources: tuple[str, ...] = ()
    quaternion: tuple[float, float, float, float] | None = None
    contacts: Contacts | None = None
    cause: Hidden | None = None

    @property
    def quality(self) -> float:
        """Quality by geometry, 0..1; for a grasp in space the score of its planning."""
        if isinstance(self.grasp, GraspCandidate):
            return self.grasp.score
        return self.grasp.quality

    @property
    def opening(self) -> float:
        """Opening between the jaws before closing, m."""
        return self.grasp.width if self.grasp.opening is None else self.grasp.opening

    @property
    def explanation(self) -> dict[str, Any]:
        """Reasons for its rank: the parts of the belief, and a sentence."""
        if self.choice is None:
            return {}
        parts = dict(self.choice.explanation)
        parts["objects"] = list(self.sources)
        doubted = _doubted(self.remembered)
        if doubted:
            parts["doubted"] = doubted
        if self.cause is not None:
            parts["cause"] = asdict(self.cause)
        parts["text"] = _sentence(self, parts)
        return parts


@dataclass(frozen=True)
class Offer:
    """What the report of an offered grasp may leave out, since it was part of the answer.

    Parameters
    ----------
    in_object
        (x, y, z, theta) in the object's frame.
    width, opening
        Between the contacts, and between the jaws before closing, m.
    quality
        By geometry, 0..1.
    belief
        alpha and beta before the attempt.
    quaternion
        Orientation (x, y, z, w) of a grasp in space in the object's frame, else None.
    contacts
        Of a cup or of three fingers in the gripper frame; None for jaws.
    """

    in_object: tuple[float, float, float, float]
    width: float
    opening: float
    quality: float
    belief: tuple[float, float]
    quaternion: tuple[float, float, float, float] | None = None
    contacts: Contacts | None = None

    @classmethod
    def of(cls, option: Option, choice: Choice) -> Offer:
        """Return what is remembered of an option that was chosen."""
        return cls(
            option.in_object, option.grasp.width, option.opening, option.quality,
            (choice.alpha, choice.beta), option.quaternion, option.contacts,
        )  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """Return the offer as JSON."""
        made: dict[str, Any] = {
            "in_object": list(self.in_object), "width": self.width, "opening": self.opening,
            "quality": self.quality, "belief": list(self.belief),
        }  # fmt: skip
        if self.quaternion is not None:
            made["quaternion"] = list(self.quaternion)
        if self.contacts is not None:
            made["contacts"] = {
                "kind": self.contacts.kind, "points": self.contacts.points.tolist(),
                "normals": self.contacts.normals.tolist(),
                "seal_radius": self.contacts.seal_radius,
            }  # fmt: skip
        return made

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> Offer:
        """Return the offer that JSON holds.

        Raises
        ------
        ValueError, TypeError, KeyError
            It is none.
        """
        x, y, z, theta = _numbers(given["in_object"])
        alpha, beta = _numbers(given["belief"])
        width, opening, quality = _numbers(given[name] for name in ("width", "opening", "quality"))
        quaternion = contacts = None
        if given.get("quaternion") is not None:
            qx, qy, qz, qw = _numbers(given["quaternion"])
            quaternion = qx, qy, qz, qw
        if given.get("contacts") is not None:
            at = given["contacts"]
            contacts = Contacts(
                at["kind"], np.array(at["points"], np.float64), np.array(at["normals"], np.float64),
                at["seal_radius"],
            )  # fmt: skip
        place = (x, y, z, theta)
        return cls(place, width, opening, quality, (alpha, beta), quaternion, contacts)


def _numbers(given: Iterable[Any]) -> list[float]:
    values = [float(value) for value in given]
    if not all(math.isfinite(value) for value in values):
        raise ValueError(f"expected finite numbers: {values}")
    return values


@dataclass(frozen=True)
class Decision:
    """The engine's answer to one task.

    Parameters
    ----------
    object
        IRI of the object, empty if unknown.
    exemplar
        IRI of the single thing, empty if unknown.
    recognition
        What it rests on; None where it was made before the server started, or at another one.
    offers
        Offered grasps by id.
    times
        Durations of the steps, s.
    asked_by
        Name of the robot whose task it is; empty if it is not known.
    """

    object: str
    recognition: Recognition | None
    offers: Mapping[str, Offer] = field(default_factory=dict)
    times: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    asked_by: str = ""
    exemplar: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return as JSON what outlasts the server's process: all but what it rests on, and whose
        it is.
        """
        return {
            "object": self.object, "seed": self.seed, "times": dict(self.times),
            "exemplar": self.exemplar,
            "offers": {name: offer.to_json() for name, offer in self.offers.items()},
        }  # fmt: skip

    @classmethod
    def from_json(cls, given: Mapping[str, Any], asked_by: str) -> Decision:
        """Return the decision that JSON holds.

        Raises
        ------
        ValueError, TypeError, KeyError, AttributeError
            It is none.
        """
        times = {str(name): float(seconds) for name, seconds in given["times"].items()}
        offers = {str(name): Offer.from_json(offer) for name, offer in given["offers"].items()}
        return cls(
            str(given["object"]), None, offers, times, int(given["seed"]), asked_by,
            str(given["exemplar"]),
        )  # fmt: skip


def graph_against_geometry(first: Option, alone: Option) -> str:
    """Return in words how the graph changed the choice: what it says of the first grasp, where the
    robot would have grasped without it, and what the graph believes to speak against that.
    """
    assert first.choice is not None
    remembered, (won, lost) = first.remembered, first.choice.explanation["graph"]
    if remembered is not None and remembered.attempts:
        evidence = f"held {remembered.successes} of {remembered.attempts}"
    else:
        # Outcomes beside a grasp count for a part each, so that these are no whole numbers.
        beside = f"{won:.1f} held, {lost:.1f} lost around it"
        evidence = beside if won + lost >= MIN_EVIDENCE else "nothing yet about this grasp"
    (x, y, z, theta), (u, v, w, phi) = first.in_object, alone.in_object
    away = math.dist((x, y, z), (u, v, w))
    turned = abs((theta - phi + math.pi / 2) % math.pi - math.pi / 2)
    if first.id == alone.id or (away < _SAME_M and turned < _SAME_RAD):
        return f"graph: {evidence}; alone: the same grasp, quality {alone.quality:.2f}"
    turn = f", turned by {math.degrees(turned):.0f} degrees" if turned > _SAME_RAD else ""
    return (
        f"graph: {evidence}; alone: {1000 * away:.0f} mm from there{turn}, "
        f"quality {alone.quality:.2f}"
        + (f"; not there, because {_cause_words(alone.cause)}" if alone.cause else "")
    )


def _cause_words(cause: Hidden) -> str:
    """Return a cause in words: what it is, where along the object, and how likely."""
    where = f"from {1000 * cause.start:.0f} to {1000 * cause.end:.0f} mm along it"
    what = "its weight lies" if cause.kind == "mass" else "it gives way"
    return f"{what} {where} with a chance of {cause.probability:.2f}"


def _doubted(remembered: Remembered | None) -> list[dict[str, Any]]:
    """Return the robots whose reports on a grasp count for less, with their part."""
    by_robot: dict[str, dict[str, Any]] = {}
    for tally in remembered.tallies if remembered is not None else ():
        if tally.robot:
            nothing = {"robot": tally.robot, "attempts": 0, "held": 0, "weight": tally.weight}
            entry = by_robot.setdefault(tally.robot, nothing)
            entry["attempts"] += tally.count
            entry["held"] += tally.count if tally.held else 0
    return [by_robot[robot] for robot in sorted(by_robot)]


def _sentence(option: Option, parts: Mapping[str, Any]) -> str:
    """Return the explanation in words."""
    assert option.choice is not None
    won, lost = parts["graph"]
    clauses = [f"geometry rates it {parts['quality']:.2f}"]
    if parts["hidden"] < LOWERED:
        why = f", because {_cause_words(option.cause)}" if option.cause else ""
        clauses.append(
            f"attempts elsewhere on it and on others like it leave {parts['hidden']:.2f} of "
            f"that{why}"
        )
    if option.remembered is not None and option.remembered.attempts:
        remembered = option.remembered
        clauses.append(f"it held {remembered.successes} of {remembered.attempts} times")
    for doubt in parts.get("doubted", ()):
        who = unquote(tail(iri(doubt["robot"])))
        clauses.append(
            f"{doubt['attempts']} of these from {who} count {doubt['weight']:.2f} each, because "
            "its reports differ from those of others"
        )
    if max(won, lost) >= MIN_EVIDENCE:
        count = len(option.sources)
        where = f" on {count} object{'' if count == 1 else 's'}" if count else ""
        clauses.append(f"this and similar grasps{where} count {won:.1f} held, {lost:.1f} lost")
    if max(parts["episode"]) >= 0.05:
        clauses.append(
            f"tries just now add {parts['episode'][0]:.1f} and {parts['episode'][1]:.1f}"
        )
    low, high = option.choice.interval90
    chance = f"chance {option.choice.mean:.2f} ({low:.2f} to {high:.2f})"
    how = {"proven": "proven, so it goes first", "sample": "drawn among the best",
           "mean": "in order of chance"}[parts["selected_by"]]  # fmt: skip
    return f"{chance}: {'; '.join(clauses)}; {how}"
