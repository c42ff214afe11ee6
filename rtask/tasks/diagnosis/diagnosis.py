"""The causes of a failure with their chances, and the smallest change that would have mended it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rtask.tasks.diagnosis.attempt import Failure
from rtask.tasks.diagnosis.changes import Change, changes_of
from rtask.tasks.diagnosis.evidence import Clue, clues_of
from rtask.tasks.diagnosis.hypotheses import (
    HOLDS,
    UNKNOWN,
    Hypothesis,
    hypotheses_of,
    report_chance,
)
from rtask.tasks.diagnosis.words import cause_in_words

__all__ = ["Cause", "Diagnosis", "beliefs_of", "diagnose"]

BOUND = 0.6
"""Chance at which a change is taken to mend a failure."""
_SETTLED = 0.6
"""Chance of the first cause from which a change may be said to mend."""
_SETTLED_UNREPORTED = 0.65
"""The same where robots seldom report this cause as they did: all that stops an arm is tracking."""
_TELLING = 0.15
"""Chance of a report under a cause from which the report speaks of it."""
_HIDDEN = frozenset(("centre_of_mass", "weak_zone"))
"""Causes that are told apart late, and mended alike: it is held elsewhere."""
_LIKELY = 0.05
_TOLD_APART = 0.1
"""A change that is surer than the same once more by less than this is not told apart from it."""


@dataclass(frozen=True)
class Cause:
    """What may have made an attempt fail.

    Parameters
    ----------
    kind
        Its code: centre_of_mass, weak_zone, slippery, stale_place ...; unknown where it is none
        that has a code.
    chance
        0..1, given all that the graph knows.
    text
        In words.
    evidence
        What speaks for it, and against it, in words.
    """

    kind: str
    chance: float
    text: str
    evidence: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "kind": self.kind, "chance": round(self.chance, 4), "text": self.text,
            "evidence": list(self.evidence),
        }  # fmt: skip


@dataclass(frozen=True)
class Diagnosis:
    """Why something failed.

    Parameters
    ----------
    failure
        What failed, and what is known around it.
    causes
        Likeliest first; those below one in twenty are left out, unknown never.
    change
        The smallest one under which it would have held, else the surest, which may be the same
        once more; None where nothing failed.
    others
        Further changes that might mend it, by their chance.
    again
        Chance that the same once more holds, 0..1.
    """

    failure: Failure
    causes: tuple[Cause, ...]
    change: Change | None
    others: tuple[Change, ...]
    again: float = 0.0

    @property
    def mends(self) -> bool:
        """Whether the change is expected to suffice, and the cause that it mends is known.

        Another hand mends most of what may be the cause, and is no answer as long as that is open.
        """
        if self.change is None or not self.causes or self.causes[0].kind == UNKNOWN:
            return False
        first = self.causes[0]
        is_reported = report_chance(first.kind, self.failure.tried.reason) >= _TELLING
        alike = _HIDDEN if first.kind in _HIDDEN else {first.kind}
        chance = sum(cause.chance for cause in self.causes if cause.kind in alike)
        is_settled = chance >= (_SETTLED if is_reported else _SETTLED_UNREPORTED)
        return is_settled and self.change.chance >= BOUND

    @property
    def text(self) -> str:
        """The diagnosis in words, and why the step was its robot's unless that was as planned."""
        whose = [self.failure.assignment] if self.failure.assignment else []
        if not self.failure.has_ended:
            return "\n".join([f"{self.failure.text}: it has not ended", *whose])
        if self.failure.held:
            return "\n".join([f"{self.failure.text}: it held", *whose])
        return "\n".join([*self._lines(), *whose])

    def _lines(self) -> list[str]:
        lines = [f"{self.failure.text}: failed ({self.failure.tried.reason or 'not said why'})"]
        for cause in self.causes:
            lines.append(f"  {cause.chance:.2f}  {cause.text}")
            lines += [f"          {clue}" for clue in cause.evidence]
        if self.failure.is_cut:
            lines.append(f"  judged by the latest {len(self.failure.others)} other attempts alone")
        if self.change is not None and self.mends:
            chance = self.change.chance
            lines.append(f"it would have held (chance {chance:.2f}): {self.change.text}")
        elif self.change is not None:
            lines.append("no change that is known would have mended it")
            if self.change.chance - self.again < _TOLD_APART:
                return lines
            lines.append(f"  at best ({self.change.chance:.2f}): {self.change.text}")
        lines += [f"  or ({change.chance:.2f}): {change.text}" for change in self.others]
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        failure = self.failure
        return {
            "subject": failure.subject, "attempt": failure.attempt, "step": failure.step,
            "ended": failure.has_ended, "assignment": failure.assignment,
            "held": failure.held, "reason": failure.tried.reason, "text": self.text,
            "causes": [cause.to_dict() for cause in self.causes],
            "change": None if self.change is None else self.change.to_dict(),
            "mends": self.mends, "others": [change.to_dict() for change in self.others],
        }  # fmt: skip


def diagnose(failure: Failure) -> Diagnosis:
    """Return the causes of a failure by Bayes' rule, and what would have mended it."""
    if failure.held or not failure.has_ended:
        return Diagnosis(failure, (), None, ())
    clues, beliefs = clues_of(failure), beliefs_of(failure)
    hypotheses, chances = [each for each, _ in beliefs], [chance for _, chance in beliefs]
    changes = []
    for change in changes_of(failure):
        held = sum(
            chance * HOLDS * hypothesis.share(change.tried)
            for hypothesis, chance in zip(hypotheses, chances, strict=True)
        )
        changes.append(change.with_chance(held))
    again = next((change.chance for change in changes if change.kind == "again"), 0.0)
    # The smallest that suffices; of equally small ones, the surest; without any, the surest at all.
    changes.sort(key=lambda change: (change.chance < BOUND, change.size, -change.chance))
    if changes and changes[0].chance < BOUND:
        changes.sort(key=lambda change: -change.chance)
    others = _distinct(changes[1:], changes[:1])
    causes = _causes(failure, hypotheses, chances, clues)
    return Diagnosis(failure, causes, changes[0] if changes else None, others, again)


def beliefs_of(failure: Failure) -> list[tuple[Hypothesis, float]]:
    """Return each hypothesis about a failure with its chance; the chances sum to 1."""
    hypotheses = hypotheses_of(failure)
    chances = _posterior(failure, hypotheses, clues_of(failure))
    return list(zip(hypotheses, chances, strict=True))


def _posterior(
    failure: Failure, hypotheses: Sequence[Hypothesis], clues: Mapping[str, Sequence[Clue]]
) -> list[float]:
    logs = []
    for hypothesis in hypotheses:
        own = HOLDS * hypothesis.share(failure.tried)
        total = math.log(
            hypothesis.prior * (1 - own) * report_chance(hypothesis.kind, failure.tried.reason)
        )
        total += sum(math.log(clue.factor) for clue in clues.get(hypothesis.kind, ()))
        for other in failure.others:
            held = HOLDS * hypothesis.share(other)
            total += math.log(held if other.held else 1 - held)
        logs.append(total)
    most = max(logs)
    weights = [math.exp(value - most) for value in logs]
    return [weight / sum(weights) for weight in weights]


def _causes(
    failure: Failure, hypotheses: Sequence[Hypothesis], chances: Sequence[float],
    clues: Mapping[str, Sequence[Clue]],
) -> tuple[Cause, ...]:  # fmt: skip
    members: dict[str, list[tuple[Hypothesis, float]]] = defaultdict(list)
    for hypothesis, chance in zip(hypotheses, chances, strict=True):
        members[hypothesis.kind].append((hypothesis, chance))
    causes = [
        Cause(
            kind, sum(chance for _, chance in parts), cause_in_words(kind, failure, parts),
            tuple(clue.text for clue in clues.get(kind, ())),
        )
        for kind, parts in members.items()
    ]  # fmt: skip
    causes.sort(key=lambda cause: (-cause.chance, cause.kind))
    return tuple(
        cause for k, cause in enumerate(causes)
        # How much is left to causes that nobody thought of is part of every answer.
        if k == 0 or cause.chance >= _LIKELY or cause.kind == UNKNOWN
    )  # fmt: skip


def _distinct(changes: Sequence[Change], before: Sequence[Change]) -> tuple[Change, ...]:
    """Return the surest change of each other kind, at most three."""
    seen = {change.kind for change in before}
    result = []
    for change in sorted(changes, key=lambda change: -change.chance):
        if change.kind not in seen and change.kind != "again":
            seen.add(change.kind)
            result.append(change)
    return tuple(result[:3])
