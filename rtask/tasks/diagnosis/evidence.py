"""What the graph knows of an occasion that makes a cause more or less likely."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rtask.tasks.diagnosis.attempt import Failure

__all__ = ["Clue", "clues_of"]

_FRESH_S, _OLD_S = 60.0, 3600.0


@dataclass(frozen=True)
class Clue:
    """A fact of an occasion.

    Parameters
    ----------
    factor
        How many times likelier it is under the cause than otherwise.
    text
        In words.
    """

    factor: float
    text: str


def clues_of(failure: Failure) -> Mapping[str, Sequence[Clue]]:
    """Return the clues for and against each cause, by its kind."""
    clues: dict[str, list[Clue]] = defaultdict(list)
    _about_place(failure, clues)
    _about_measures(failure, clues)
    _about_record(failure, clues)
    if failure.margin is not None:
        is_close = failure.margin < 0.1
        words = "hardly" if is_close else "clearly"
        clues["wrong_identity"].append(
            Clue(5.0 if is_close else 0.4, f"recognition {words} preferred it to the next best")
        )
    if failure.is_late is not None:
        clues["late"].append(
            Clue(8.0, "it ended after its deadline") if failure.is_late
            else Clue(0.2, "it ended before its deadline")
        )  # fmt: skip
    else:
        # A motion that ran out of time is seldom cured by an earlier start where nothing was due.
        clues["late"].append(Clue(0.25, "no deadline of it is known"))
    return clues


def _about_place(failure: Failure, clues: dict[str, list[Clue]]) -> None:
    if failure.is_elsewhere:
        clues["stale_place"].append(Clue(5.0, "afterwards it was seen elsewhere, or nowhere"))
        clues["dropped"].append(Clue(2.0, "afterwards it was seen elsewhere, or nowhere"))
    else:
        # Who finds a place empty looks around, and reports what it sees.
        clues["stale_place"].append(Clue(0.4, "nobody has seen it elsewhere since"))
    if failure.age_s is not None and failure.age_s < _FRESH_S:
        clues["stale_place"].append(Clue(0.4, "its place was known since less than a minute"))
    elif failure.age_s is not None and failure.age_s > _OLD_S:
        hours = failure.age_s / 3600
        clues["stale_place"].append(Clue(3.0, f"its place was known since {hours:.0f} h"))
    near = len(failure.neighbours)
    if failure.tried.place:
        clues["collision"].append(
            Clue(0.4, "nothing else is known at that place") if near == 0
            else Clue(1.5, f"{near} other things are at that place")
        )  # fmt: skip


def _about_measures(failure: Failure, clues: dict[str, list[Clue]]) -> None:
    hand = failure.tried.hand
    for kind, value, limit, unit, words in (
        ("too_heavy", failure.mass, hand.payload, "kg", "it weighs {:.3g} of {:.3g} {}"),
        ("too_wide", failure.width, hand.opening, "m", "it is {:.3g} of {:.3g} {} wide"),
    ):
        if value is not None and limit is not None and limit > 0:
            part = value / limit
            factor = 20.0 if part > 1 else 3.0 if part > 0.85 else 0.25
            clues[kind].append(Clue(factor, words.format(value, limit, unit)))


def _about_record(failure: Failure, clues: dict[str, list[Clue]]) -> None:
    """Say what the other attempts were; their weight is in the hypotheses, so that it is 1 here."""
    own, tallies = failure.tried, Counter[tuple[str, bool]]()
    for other in failure.others:
        if other.product == own.product:
            tallies["product", other.held] += 1
        if other.hand.iri == own.hand.iri:
            tallies["hand", other.held] += 1
        if own.grasp and other.grasp == own.grasp:
            tallies["grasp", other.held] += 1

    def record(scope: str, words: str) -> list[Clue]:
        held, total = tallies[scope, True], tallies[scope, True] + tallies[scope, False]
        return [Clue(1.0, f"{words}: {held} of {total} other attempts held")] if total else []

    for kind in ("slippery", "fragile", "centre_of_mass", "weak_zone", "chance"):
        clues[kind] += record("product", "with this product")
    clues["weak_hand"] += record("hand", "with this hand")
    clues["poor_grasp"] += record("grasp", "by this grasp")
