"""All changes of a failure, each tried on branches of its own, within a budget of time."""

from __future__ import annotations

import datetime as dt
import os
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from rtask.errors import ForbiddenError, UsageError
from rtask.kb.branches.branch import Branch
from rtask.kb.branches.record import BranchRecord
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.tasks.bounds import Bounds
from rtask.tasks.diagnosis import Diagnosis, beliefs_of
from rtask.tasks.diagnosis.attempt import Failure
from rtask.tasks.diagnosis.reading import read_hands
from rtask.tasks.tasks import Tasks
from simulate.tasks.trials.believed import BelievedCause, Hidden, draw_causes
from simulate.tasks.trials.branch_run import BranchRun, run_on_branch
from simulate.tasks.trials.hand_alone import try_change
from simulate.tasks.trials.physics import MASS_KG
from simulate.tasks.trials.result import ChangeTrial, TriedChange
from simulate.tasks.trials.supposed import Supposition, suppositions

__all__ = ["Branches", "TrialOptions", "require_keep", "try_changes"]

_PREFIX = "why-trial-"
_NOTE = "a change of a failed attempt is tried here; dropped when that ends"
_LIFETIME = dt.timedelta(minutes=30)
_BUDGET = "budget: the time was over before"
_alive: set[str] = set()
_lock = threading.Lock()
Progress = Callable[[float, str], None]


class Branches(Protocol):
    """The part of a graph that a trial needs; a :class:`~rtask.KnowledgeBase` in a folder has it.

    It makes branches and reads nothing: all else is done on these.
    """

    def branch(
        self, name: str | None = None, *, access: Access | None = None,
        lifetime: dt.timedelta | None = None, note: str = "",
    ) -> Branch[KnowledgeBase]:  # fmt: skip
        """Make a branch that begins as the graph is now."""

    def branches(self) -> list[BranchRecord]:
        """Return the branches."""

    def drop_branch(self, name: str, *, access: Access | None = None) -> BranchRecord:
        """Delete a branch."""


@dataclass(frozen=True)
class TrialOptions:
    """How much is tried.

    Parameters
    ----------
    tries
        Draws of the cause, each of which every change meets; 1 to 20.
    seed
        Of all draws.
    budget_s
        Time after which no try begins, s; what is left is answered as not tried.
    keep
        Name of the branch on which the best change is kept, after its first try that held; empty
        for none.
    access
        Rights of the caller; None = those of the owner.
    """

    tries: int = 5
    seed: int = 0
    budget_s: float = 30.0
    keep: str = ""
    access: Access | None = None


def try_changes(
    graph: Branches,
    subject: str,
    options: TrialOptions,
    progress: Progress = lambda part, text: None,
) -> tuple[Diagnosis, ChangeTrial]:
    """Try what would have mended a failure on branches of the graph, which itself stays as it is.

    A branch that a killed program left is dropped when the next trial begins, or after half an
    hour.

    Parameters
    ----------
    subject
        As :meth:`rtask.tasks.Tasks.why` takes it.
    progress
        Called with the part that is done, 0..1, and words; may raise to end the trial.

    Raises
    ------
    UnknownTermError, UsageError
        As :meth:`rtask.tasks.Tasks.why`.
    UnsupportedError
        The graph is in memory or open for reading, so that it has no branches.
    ForbiddenError
        The caller may write nothing, or may not read all that is there.
    QueueFullError
        As many branches are open as may be.
    """
    access = options.access
    if access is not None and access.reads is not None:
        raise ForbiddenError("a trial plans with all that the graph holds, which you may not read")
    _drop_abandoned(graph)
    end_s = time.monotonic() + options.budget_s
    with _branch(graph, access) as kb:
        diagnosis = Tasks(kb).why(subject, access=access)
        hands = read_hands(Bounds(kb).select)
    if diagnosis.failure.held or diagnosis.change is None:
        return diagnosis, ChangeTrial(refusal="nothing failed")
    no_plan = _no_plan(diagnosis.failure)
    if no_plan:
        return diagnosis, _by_hand(diagnosis, options, no_plan)
    failure, beliefs = diagnosis.failure, beliefs_of(diagnosis.failure)
    with Hidden(failure, hands) as hidden:
        causes = draw_causes(hidden, beliefs, options.tries, options.seed)
        run = _Run(graph, hidden, causes, options, end_s, progress)
        changes, branch = run.all(suppositions(diagnosis))
    return diagnosis, ChangeTrial(
        changes, sum(chance for _, chance in beliefs),
        tuple(Counter(cause.hypothesis.kind for cause in causes).most_common()),
        _assumed(failure, causes), branch,
    )  # fmt: skip


@dataclass
class _Run:
    """The tries of one trial."""

    graph: Branches
    hidden: Hidden
    causes: Sequence[BelievedCause]
    options: TrialOptions
    end_s: float
    progress: Progress

    def all(self, supposed: Sequence[Supposition]) -> tuple[tuple[TriedChange, ...], str]:
        """Return what came of each change, and the name of the branch that was kept."""
        changes, runs = [], []
        plans: set[tuple[str, ...]] = set()
        for number, supposition in enumerate(supposed):
            tried, first = self._change(supposition, number, len(supposed))
            if tried.change.kind == "place" and tried.steps and tried.steps in plans:
                continue  # another hand does it: that was tried above
            plans.add(tried.steps)
            changes.append(tried)
            runs.append((tried, supposition, first))
        return tuple(changes), self._keep(runs)

    def _change(
        self, supposition: Supposition, number: int, count: int
    ) -> tuple[TriedChange, BelievedCause | None]:
        """Return what came of one change, and the first draw under which it held."""
        change, done = supposition.change, list[BranchRun]()
        first: BelievedCause | None = None
        if supposition.refusal:
            return TriedChange(change, refusal=supposition.refusal), None
        for k, cause in enumerate(self.causes):
            part = (number + k / len(self.causes)) / count
            self.progress(part, f"{change.text}: try {k + 1} of {len(self.causes)}")
            if time.monotonic() >= self.end_s:
                break
            with _branch(self.graph, self.options.access) as kb:
                run = run_on_branch(kb, self.hidden, supposition, cause)
            if run.refusal:
                return TriedChange(change, refusal=run.refusal), None
            done.append(run)
            if run.held and first is None:
                first = cause
        if not done:
            return TriedChange(change, refusal=_BUDGET), None
        failed = next((run.failed_with for run in done if not run.held), "")
        steps = next((run.steps for run in done if run.steps), ())
        physical = sum(run.is_physical for run in done)
        held = sum(run.held for run in done)
        return TriedChange(change, len(done), held, physical, steps, failed), first

    def _keep(self, runs: Sequence[tuple[TriedChange, Supposition, BelievedCause | None]]) -> str:
        """Carry the best change out once more, on a branch that stays; return its name."""
        best = next((run for run in runs if run[0].verdict == "held"), None)
        if not self.options.keep or best is None or best[2] is None:
            return ""
        note = f"{best[0].change.text}, tried after {self.hidden.failure.subject}"
        branch = self.graph.branch(self.options.keep, access=self.options.access, note=note)
        try:
            run_on_branch(branch.graph, self.hidden, best[1], best[2])
        except BaseException:
            branch.drop(access=self.options.access)
            raise
        branch.close()
        return self.options.keep


@contextmanager
def _branch(graph: Branches, access: Access | None) -> Iterator[KnowledgeBase]:
    """Yield a branch that is dropped in the end."""
    name = f"{_PREFIX}{os.getpid()}-{secrets.token_hex(4)}"
    with _lock:
        _alive.add(name)
    try:
        branch = graph.branch(name, access=access, lifetime=_LIFETIME, note=_NOTE)
        try:
            yield branch.graph
        finally:
            graph.drop_branch(name)
    finally:
        with _lock:
            _alive.discard(name)


def _drop_abandoned(graph: Branches) -> None:
    """Drop the branches of trials that were killed.

    One process at a time writes to a folder, so that those that this one does not know are of
    programs that have ended.
    """
    with _lock:
        alive = set(_alive)
    for record in graph.branches():
        if record.name.startswith(_PREFIX) and record.note == _NOTE and record.name not in alive:
            graph.drop_branch(record.name)


def require_keep(keep: str) -> None:
    """Refuse a name that a trial would take for one of its own.

    Raises
    ------
    UsageError
        It begins like theirs.
    """
    if keep.startswith(_PREFIX):
        raise UsageError(f"keep: names that begin with {_PREFIX} are those of trials", field="keep")


def _no_plan(failure: Failure) -> str:
    """Return why nothing can be planned again; empty if it can."""
    if not failure.tried.thing:
        return "the graph does not say which thing it was, so that nothing is planned with it"
    if not failure.origin:
        return "the graph does not say where the thing stood, so that nothing is planned with it"
    return ""


def _by_hand(diagnosis: Diagnosis, options: TrialOptions, why: str) -> ChangeTrial:
    """Return what a hand without an arm makes of the first change, where no plan is possible."""
    trial = try_change(diagnosis, options.tries, options.seed)
    if diagnosis.change is None or trial.refusal or not trial.reproduces:
        held = "what failed holds in physics as well, which then says nothing of a change"
        return ChangeTrial(refusal=f"{why}; by a hand alone: {trial.refusal or held}")
    tried = TriedChange(
        diagnosis.change, trial.tries, trial.held, trial.tries,
        ("a hand without an arm takes it",),
    )  # fmt: skip
    return ChangeTrial((tried,), trial.believed, assumed=(why, *trial.assumed))


def _assumed(failure: Failure, causes: Sequence[BelievedCause]) -> tuple[str, ...]:
    lines = ["arms get to where the graph says that they reach, at once, and drop nothing there"]
    if any(cause.thing is not None for cause in causes):
        lines.append("in physics it is a box as high as it is wide, taken across its width")
        if failure.mass is None:
            lines.append(f"it weighs {MASS_KG} kg")
    return tuple(lines)
