"""Movements that robots recorded, and whether another body can follow them (Kehoe 2014, 1.2).

A movement is a list of joint values: it means something for the body it was recorded on, and for
others only if their joints are said to take the place of those. What does not fit is named with the
reason, and never adapted silently.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.engine.policy import JUDGED
from rtask.interop.episodes.motion import Motion
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.engine.grippers import StoredGripper

__all__ = ["Body", "JointPart", "MotionRecord", "fitted", "motion_records", "thinned"]


@dataclass(frozen=True)
class MotionRecord:
    """The recording of one judged attempt.

    Parameters
    ----------
    attempt, robot, hand, grasp, object, blob
        IRIs.
    model
        Name of the model that the robot was registered with when it reported; "" if that is not
        known.
    ended
        When the attempt ended, as in the graph.
    """

    attempt: str
    robot: str
    robot_name: str
    hand: str
    hand_name: str
    gripper_type: str
    model: str
    object: str
    grasp: str
    held: bool
    ended: str
    blob: str


@dataclass(frozen=True)
class JointPart:
    """A joint that is to follow a recorded one.

    Parameters
    ----------
    name, recorded
        Of the joint, and of the recorded one whose place it takes.
    scale, offset
        The joint's value is that of the recorded one times ``scale`` plus ``offset``, rad or m.
    lower, upper
        Limits of the joint, rad or m.
    """

    name: str
    recorded: str
    scale: float = 1.0
    offset: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True)
class Body:
    """Who asks: the model and the hand that shall follow, and its joints as far as it says them."""

    model: str
    hand_name: str
    gripper_type: str
    joints: Sequence[JointPart] = ()

    @classmethod
    def of(cls, context: Context, hand: StoredGripper, joints: Sequence[JointPart] = ()) -> Body:
        """Return the body of a registered hand; ``model`` is "" if none is stored."""
        rows = context.kb.select(
            f"{PREFIXES} SELECT ?name {{ {hand.robot} rt:hasRobotModel/rt:modelName ?name }}"
        )
        model = str(rows[0].value("name")) if rows else ""
        return cls(model, hand.gripper.name, hand.gripper.gripper_type, joints)

    def difference(self, record: MotionRecord) -> str:
        """Say how the body of a recording differs from this one; "" if it is the same."""
        if not record.model:
            return "the model of the robot was not stored with it"
        if record.model != self.model:
            return f"recorded on {record.model}, not on {self.model or 'a model that is not known'}"
        if (record.hand_name, record.gripper_type) != (self.hand_name, self.gripper_type):
            return f"recorded with {record.hand_name}, not with {self.hand_name}"
        return ""


def motion_records(
    context: Context, thing: str | None, is_held: bool, most: int
) -> tuple[list[MotionRecord], int]:
    """Return the recordings of judged attempts, the latest first, and how many there are.

    Parameters
    ----------
    thing
        IRI of the object that was grasped; None = any.
    is_held
        Whether to leave out attempts that did not hold, by the verdicts of people if there are any.
    most
        Largest number.
    """
    about = "" if thing is None else f"VALUES ?object {{ {iri(thing)} }}"
    pattern = f"""
  {about}
  ?motion a rt:JointTrajectory ; prov:wasGeneratedBy ?attempt ; rt:hasBlob ?blob .
  {JUDGED}
  ?object rt:hasGrasp ?grasp ; rt:objectId ?id .  # not the single thing, of which it is inferred
  ?attempt rt:activates ?hand . ?robot rt:hasEndEffector ?hand ; rt:name ?robot_name .
  ?hand rt:name ?hand_name ; rt:gripperType ?gripper_type
  OPTIONAL {{ ?motion rt:ofRobotModel/rt:modelName ?model }}
  {"FILTER(?held)" if is_held else ""}
"""
    columns = (
        "?attempt ?robot ?robot_name ?hand ?hand_name ?gripper_type ?model ?object ?grasp ?held "
        "?ended ?blob"
    )
    each = f"SELECT DISTINCT {columns} WHERE {{{pattern}}}"
    rows = context.kb.select(f"{PREFIXES}\n{each} ORDER BY DESC(?ended) ?attempt LIMIT {most + 1}")
    records = [_record(row.to_dict()) for row in rows[:most]]
    if len(rows) <= most:
        return records, len(records)
    # What was not looked at may be just what the caller can follow.
    counted = context.kb.select(f"{PREFIXES}\nSELECT (COUNT(*) AS ?n) WHERE {{ {{ {each} }} }}")
    return records, int(str(counted[0].value("n")))


def _record(row: Mapping[str, Any]) -> MotionRecord:
    texts = {name: str(value or "") for name, value in row.items() if name != "held"}
    return MotionRecord(held=bool(row["held"]), **{"model": "", **texts})


def fitted(
    motion: Motion, record: MotionRecord, body: Body
) -> tuple[tuple[str, ...], NDArray[np.float64]] | str:
    """Return a recording with the joints of a body, or say why it cannot follow it.

    The opening of the hand, 0 to 1, is carried over to the body's hand.

    Returns
    -------
    names, positions (n, joints) float
        rad or m; or the reason.
    """
    parts = body.joints or [JointPart(name, name) for name in motion.joints]
    sources = {part.recorded for part in parts}
    if body.joints and record.hand_name in motion.joints and record.hand_name not in sources:
        parts = [*parts, JointPart(body.hand_name, record.hand_name, lower=0.0, upper=1.0)]
        sources.add(record.hand_name)
    unknown = [part.recorded for part in parts if part.recorded not in motion.joints]
    if unknown:
        return f"it has no joint {', '.join(unknown)}; its joints: {', '.join(motion.joints)}"
    free = [name for name in motion.joints if name not in sources]
    if free:
        return f"no joint takes the place of {', '.join(free)}"
    columns = [motion.joints.index(part.recorded) for part in parts]
    scales = np.array([part.scale for part in parts])
    positions = motion.positions[:, columns] * scales + np.array([part.offset for part in parts])
    for part, column in zip(parts, positions.T, strict=True):
        if column.min() < part.lower or column.max() > part.upper:
            return (
                f"{part.name} would move from {column.min():.3g} to {column.max():.3g}, beyond its "
                f"limits, {part.lower:.3g} to {part.upper:.3g}"
            )
    return tuple(part.name for part in parts), positions


def thinned(motion: Motion, most: int) -> Motion:
    """Return at most so many samples of a motion, at equal steps of time, joints between."""
    count = len(motion.times)
    if count <= most:
        return motion
    times = np.linspace(motion.times[0], motion.times[-1], most)

    def at(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(times, motion.times, column) for column in values.T], axis=1)

    return replace(
        motion, times=times, positions=at(motion.positions), commands=at(motion.commands)
    )
