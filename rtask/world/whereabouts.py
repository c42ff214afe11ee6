"""Questions about where things are, and their answers. "Not known" is an answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError

__all__ = ["Question", "Whereabouts", "Whereis"]


@dataclass(frozen=True)
class Question:
    """A question about where something is, or was.

    Parameters
    ----------
    name
        IRI or name of a thing or product, an objectId, or a kind of object.
    at
        Unix time, s; None for now.
    frame
        Frame for poses: its IRI, its name in tf, or ``robot/name``; None for the frames in which
        they were measured.
    near
        Name or IRI of a place, a robot, a frame or a thing: only what is there, or within
        ``radius_m`` of it. With a robot and the reach of its arm: what is in its reach.
    radius_m
        How near that is, m.
    max_things
        Things of that name that are looked at.
    """

    name: str
    at: float | None = None
    frame: str | None = None
    near: str | None = None
    radius_m: float = 0.5
    max_things: int = 200

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise UsageError("name is empty: what is asked for?", field="name")
        if not (np.isfinite(self.radius_m) and self.radius_m > 0):
            raise UsageError(f"radius_m: expected more than 0 m, got {self.radius_m}",
                             field="radius_m")  # fmt: skip
        if self.max_things < 1:
            raise UsageError(f"max_things: expected at least 1, got {self.max_things}",
                             field="max_things")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Whereabouts:
    """Where one thing was at the time in question.

    Parameters
    ----------
    exemplar, product, label
        IRIs of the thing and of its product, and its name. The thing is "" if robots saw the
        product before things were told apart.
    relation
        ``at`` a pose, ``on``, ``in`` or ``held_by`` the place; ``unknown`` if nobody knows.
    place, place_label
        IRI and name of the support, container or hand; or empty.
    frame, frame_id, frame_from_exemplar
        IRI and name of the frame, and the pose (4, 4) in it, m; empty and None without a pose.
    frame_reason
        Why this is not the frame that was asked for, in words; empty if it is.
    since_s, seen_s, until_s
        Unix time since when it was there, when it was last seen there, and until when, if it has
        ended.
    agent
        Name of who said so.
    still_there
        Chance that it was still there, 0..1; 0 if nobody knows.
    radius90_m
        Distance within which it was with a chance of 90 %, m; None without a pose.
    doubts
        Other things that it may be, with the chances.
    text
        The same in words.
    """

    exemplar: str
    product: str
    label: str
    relation: str
    place: str = ""
    place_label: str = ""
    frame: str = ""
    frame_id: str = ""
    frame_from_exemplar: NDArray[np.float64] | None = None
    frame_reason: str = ""
    since_s: float | None = None
    seen_s: float | None = None
    until_s: float | None = None
    agent: str = ""
    still_there: float = 0.0
    radius90_m: float | None = None
    doubts: tuple[tuple[str, float], ...] = ()
    text: str = ""

    @property
    def is_known(self) -> bool:
        """Whether anybody knows where it was."""
        return self.relation != "unknown"


@dataclass(frozen=True)
class Whereis:
    """Answer to a question: the things that it is about, best known first.

    Parameters
    ----------
    time_s
        Unix time that it is about.
    text
        The answer in words.
    things_untried
        Further things of that name that were not looked at, or whose frames lead too far to tell
        whether they are near: what the answer does not name is then not decided.
    """

    time_s: float
    exemplars: tuple[Whereabouts, ...]
    text: str
    things_untried: int = 0

    @property
    def is_known(self) -> bool:
        """Whether the place of any of them is known."""
        return any(exemplar.is_known for exemplar in self.exemplars)
