"""What came of each change that was tried, and of those that were not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scipy import stats

from rtask.tasks.diagnosis.changes import Change

__all__ = ["ChangeTrial", "TriedChange"]


@dataclass(frozen=True)
class TriedChange:
    """One change, and what came of its plan.

    Parameters
    ----------
    change
        The changed fact.
    tries, held
        How often its plan was carried out, and how often every step of it held.
    in_physics
        In how many of the tries a hand took the thing in physics; in the others the belief itself
        decides whether a grasp holds.
    steps
        The plan in words; empty where there is none.
    failed_with
        What the robots said of the first failure; empty if all held.
    refusal
        Why it was not tried; empty if it was. That is not that it would have failed.
    """

    change: Change
    tries: int = 0
    held: int = 0
    in_physics: int = 0
    steps: tuple[str, ...] = ()
    failed_with: str = ""
    refusal: str = ""

    @property
    def verdict(self) -> str:
        """held, failed, or not_tried; held in most tries is held."""
        if not self.tries:
            return "not_tried"
        return "held" if 2 * self.held > self.tries else "failed"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share of tries in which it held (Wilson 1927)."""
        if not self.tries:
            return 0.0, 1.0
        share = stats.binomtest(self.held, self.tries).proportion_ci(0.95, method="wilson")
        return float(share.low), float(share.high)

    @property
    def text(self) -> str:
        """The change with its outcome, in words."""
        if not self.tries:
            return f"not tried: {self.change.text}: {self.refusal}"
        low, high = self.interval
        lines = [f"held {self.held} of {self.tries} ({low:.2f} to {high:.2f}): {self.change.text}"]
        lines.append(f"  plan: {'; '.join(self.steps)}")
        if self.failed_with:
            lines.append(f"  failed: {self.failed_with}")
        if not self.in_physics:
            lines.append("  no physics: the believed cause alone decides")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            **self.change.to_dict(), "verdict": self.verdict, "tries": self.tries,
            "held": self.held, "interval": [round(end, 4) for end in self.interval],
            "in_physics": self.in_physics, "steps": list(self.steps),
            "failed_with": self.failed_with, "refusal": self.refusal,
        }  # fmt: skip


_ORDER = ("held", "not_tried", "failed")
"""What nobody tried is no worse than what is known to have failed."""


@dataclass(frozen=True)
class ChangeTrial:
    """What came of all changes of a failure.

    Parameters
    ----------
    changes
        In the order in which the answer proposed them.
    believed
        Chance of the causes that were drawn, 0..1.
    drawn
        How often each cause was drawn, by its kind.
    assumed
        What the graph does not say, in words.
    branch
        Name of the branch that was kept; empty if none was.
    refusal
        Why nothing at all was tried; empty if something was.
    """

    changes: tuple[TriedChange, ...] = ()
    believed: float = 0.0
    drawn: tuple[tuple[str, int], ...] = ()
    assumed: tuple[str, ...] = ()
    branch: str = ""
    refusal: str = ""

    @property
    def ranked(self) -> tuple[TriedChange, ...]:
        """The changes: what held, then what was not tried, then what failed."""
        return tuple(sorted(self.changes, key=lambda tried: _ORDER.index(tried.verdict)))

    @property
    def holds(self) -> bool:
        """Whether one of the changes held in most of its tries."""
        return any(tried.verdict == "held" for tried in self.changes)

    @property
    def text(self) -> str:
        """All of it in words."""
        where = (
            f"branch {self.branch} is kept; nothing else was stored" if self.branch
            else "nothing was stored"
        )  # fmt: skip
        if self.refusal:
            return f"not tried: {self.refusal}; {where}"
        causes = ", ".join(f"{kind} {count}" for kind, count in self.drawn)
        lines = [
            f"tried on a branch of the graph, in simulation; {where}",
            f"  if it is one of the causes that were drawn (chance {self.believed:.2f}): {causes}",
            "  it explains; followed instead of the proposal above, it held less often in a study",
        ]
        for tried in self.ranked:
            lines += [f"  {line}" for line in tried.text.split("\n")]
        return "\n".join([*lines, *(f"  assumed: {each}" for each in self.assumed)])

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values; changes in the order of :attr:`ranked`."""
        return {
            "holds": self.holds, "believed": round(self.believed, 4),
            "drawn": dict(self.drawn), "changes": [tried.to_dict() for tried in self.ranked],
            "assumed": list(self.assumed), "branch": self.branch, "refusal": self.refusal,
            "text": self.text,
        }  # fmt: skip
