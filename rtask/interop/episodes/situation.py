"""What a policy is told of an episode beside the joints: the task in words, the robot, the pose."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.interop.episodes.episode import Episode
from rtask.interop.episodes.motion import Motion
from rtask.rdf.namespaces import PREFIXES, local_name, values
from rtask.rdf.terms import moment

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["POSE", "Situation", "situations_of"]

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Numbers of a pose: m, and a quaternion."""
_NOBODY = "unnamed object"


@dataclass(frozen=True)
class Situation:
    """The task of an episode and where it began.

    Parameters
    ----------
    task
        In words: name, colours and kind of the object.
    robot_type
        Model of the robot; its name where no model is stated.
    frame_id
        Frame of the pose; empty if it is not known.
    pose : (7,) float64 or None
        The robot's last estimate of the object's pose that held when the attempt began; see
        :data:`POSE`.
    """

    task: str
    robot_type: str
    frame_id: str = ""
    pose: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class _Seen:
    """An estimate of a pose, until an attempt ended it."""

    time: dt.datetime
    end: dt.datetime | None
    robot: str
    frame_id: str
    pose: NDArray[np.float64]


def situations_of(kb: GraphCore, episodes: Iterable[Episode]) -> dict[str, Situation]:
    """Return the situations of episodes by attempt.

    Parameters
    ----------
    kb
        The graph that has them.
    """
    recorded = list(episodes)
    things = sorted({episode.thing for episode in recorded if episode.thing})
    kinds, colours = _looks(kb, things)
    models = {
        str(row.value("robot")): local_name(str(row.value("model"))).rpartition("/")[2]
        for row in kb.select(
            f"{PREFIXES} SELECT ?robot ?model {{ ?robot rt:hasRobotModel ?model }} ORDER BY ?model"
        )
    }
    poses, wordings = _poses(kb, things), _tasks_in_words(kb)
    made = {}
    for episode in recorded:
        thing = episode.thing or ""
        begun = min(episode.started or episode.ended, episode.ended)
        frame, pose = _recorded(kb, episode)
        for seen in poses.get(thing, ()) if pose is None else ():  # in the order of time
            # An attempt ends the estimates of what it may move.
            holds = seen.time <= begun and (seen.end is None or seen.end >= begun)
            if seen.robot == episode.robot and holds:
                frame, pose = seen.frame_id, seen.pose
        made[episode.attempt] = Situation(
            wordings.get(episode.attempt)
            or _task(episode.thing_name or _NOBODY, colours.get(thing, []), kinds.get(thing, "")),
            models.get(episode.robot, "") or episode.robot_name, frame, pose,
        )  # fmt: skip
    return made


def _recorded(kb: GraphCore, episode: Episode) -> tuple[str, NDArray[np.float64] | None]:
    """Return the pose that was kept with the joints of an episode, and its frame.

    It is that of the view before the attempt; the graph has a robot's latest estimates alone, and
    no new one for what moved by less than 2 cm.
    """
    if not episode.motion:
        return "", None
    motion = Motion.from_bytes(kb.blobs.read(episode.motion))
    return motion.frame_id, motion.pose


def _tasks_in_words(kb: GraphCore) -> dict[str, str]:
    """Return the tasks of attempts at no stored object, which are in the words of others."""
    rows = kb.select(f"""{PREFIXES}
SELECT ?attempt ?words {{ ?task rt:through ?attempt ; rt:taskName ?words
  FILTER NOT EXISTS {{ ?task rt:handles ?thing }} }} ORDER BY ?attempt ?words""")
    return {str(row.value("attempt")): str(row.value("words")) for row in rows}


def _task(name: str, colours: list[str], kind: str) -> str:
    """Return what the robot was to do, in words: the condition of a policy."""
    if name == _NOBODY and not (colours or kind):
        return "unknown task"
    look = " ".join(part for part in (" and ".join(colours), kind or "object") if part)
    if not (colours or kind):
        return f"pick up {name} and put it into the box"
    article = "an" if look[0] in "aeiou" else "a"
    return f"pick up {name}, {article} {look}, and put it into the box"


def _looks(kb: GraphCore, things: list[str]) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Return the most particular kind of each thing, and its colours."""
    kinds: dict[str, dict[str, int]] = {}
    colours: dict[str, list[str]] = {}
    if not things:
        return {}, {}
    # A guess at the kind is an annotation of a type that is not asserted by itself.
    for row in kb.select(f"""{PREFIXES}
SELECT DISTINCT ?thing ?label ?above WHERE {{ VALUES ?thing {{ {values(things)} }}
  ?thing a ?kind . ?kind rdfs:subClassOf+ rt:ManipulableObject ; rdfs:label ?label
  FILTER(LANGMATCHES(LANG(?label), "en") && ?kind != rt:ManipulableObject)
  OPTIONAL {{ ?kind rdfs:subClassOf ?above FILTER(isIRI(?above)) }} }}"""):
        counted = kinds.setdefault(str(row.value("thing")), {})
        label = str(row.value("label"))
        counted[label] = counted.get(label, 0) + 1
    for row in kb.select(f"""{PREFIXES}
SELECT DISTINCT ?thing ?label WHERE {{ VALUES ?thing {{ {values(things)} }}
  ?thing rt:hasColour/rdfs:label ?label }} ORDER BY ?thing ?label"""):
        colours.setdefault(str(row.value("thing")), []).append(str(row.value("label")))
    best = {
        thing: min(counted, key=lambda label: (-counted[label], label))
        for thing, counted in kinds.items()
    }
    return best, colours


def _poses(kb: GraphCore, things: list[str]) -> dict[str, list[_Seen]]:
    """Return the estimates of each thing's pose in the order of time."""
    poses: dict[str, list[_Seen]] = {}
    if not things:
        return {}
    numbers = " ; ".join(f"rt:{name} ?{name}" for name in POSE)
    for row in kb.select(f"""{PREFIXES}
SELECT DISTINCT ?thing ?time ?end ?robot ?frame {" ".join(f"?{name}" for name in POSE)} WHERE {{
  VALUES ?thing {{ {values(things)} }}
  ?estimate rt:poseOf ?thing ; rt:estimatedPose ?pose ; prov:wasAttributedTo ?robot .
  ?pose rt:atTime ?time ; rt:inFrame/rt:frameId ?frame ; {numbers}
  OPTIONAL {{ ?estimate prov:invalidatedAtTime ?end }}
}} ORDER BY ?thing ?time ?robot ?frame"""):
        pose = np.array([float(str(row.value(name))) for name in POSE])
        end = None if row["end"] is None else moment(str(row.value("end")))
        seen = _Seen(
            moment(str(row.value("time"))), end, str(row.value("robot")), str(row.value("frame")),
            pose,
        )  # fmt: skip
        poses.setdefault(str(row.value("thing")), []).append(seen)
    return poses
