"""What would have mended a failure, tried on a branch of the graph in simulation, as a service."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Ge, Le, MaxLen, MinLen

from rtask.services import Call, Service, data_resource, method
from rtask.wire.message import Answer
from rtask.wire.types import Number, Unit, Whole

if TYPE_CHECKING:
    from rtask.tasks.diagnosis import Diagnosis
    from simulate.tasks.trials import ChangeTrial

__all__ = ["FailureTrials"]

_Tries = Annotated[Whole, Ge(1), Le(20)]
_Seed = Annotated[Whole, Ge(0)]
_Budget = Annotated[Number, Unit("s"), Ge(0), Le(300)]
_Subject = Annotated[str, MinLen(1), MaxLen(2000)]


class TriedChangeAnswer(Answer):
    """One changed fact, and what came of its plan."""

    kind: str
    """look, recognise, clear, earlier, ask, grasp, hand or place"""
    text: str
    chance: float
    """that it would have held, as the graph believes without any trial"""
    robot: str
    """IRI of the robot that would do it"""
    hand: str
    grasp: str
    along: float | None
    """place of the grasp along the longer side from its middle, m"""
    verdict: Literal["held", "failed", "not_tried"]
    """held: in most tries; not_tried says nothing about the change"""
    tries: int
    held: int
    """in how many of the tries every step held"""
    interval: list[float]
    """95 % of the share that held"""
    in_physics: int
    """in how many tries physics decided the grasp; else the believed cause alone did"""
    steps: list[str]
    """the plan in words"""
    failed_with: str
    """what robots said of the first failure; empty if all held"""
    refusal: str
    """why it was not tried; empty if it was"""


class ChangesTried(Answer):
    """All changes: those that held, those that were not tried, and those that failed."""

    subject: str
    why: str
    """the causes and what was proposed before anything was tried, in words"""
    holds: bool
    """whether a change held in most of its tries"""
    believed: float
    """chance of the causes that were drawn: all of it holds only if it is one of these"""
    drawn: dict[str, int]
    """how often each cause was drawn"""
    changes: list[TriedChangeAnswer]
    assumed: list[str]
    refusal: str
    """why nothing was tried; empty if something was"""
    text: str
    """the trial in words"""


class BestChange(Answer):
    """The change that held, on its branch."""

    holds: bool
    """whether a change held in most of its tries; else there is no branch"""
    branch: str
    text: str
    """the causes and the trial in words"""


class FailureTrials(Service):
    """What would have mended a failure, tried on branches of the graph.

    Each change that `explain_failure` proposes is stated on a branch, planned and carried out there
    in simulation, and the branch is dropped. The graph itself is never written.
    """

    name = "rtask/FailureTrials"
    version = "1.0.0"
    extra = "simulate"
    # A trial takes a processor for itself, and makes a branch at a time.
    max_workers = 1
    max_waiting = 8
    timeout_s = 330.0
    graph = data_resource("graph", summary="the graph in which it failed; it is not written")

    @method(effect="reads", scope="write")
    def try_changes(
        self,
        subject: _Subject,
        call: Call,
        tries: _Tries = 5,
        seed: _Seed = 0,
        budget: _Budget = 30.0,
    ) -> ChangesTried:
        """Try what would have mended a failure; nothing is stored.

        Parameters
        ----------
        subject
            IRI of an attempt, a task, a step or a stored plan, or an object's IRI or name.
        tries
            How many draws of the cause each change meets.
        seed
            Of the draws.
        budget
            Time after which no try begins; the rest is answered as not tried.
        """
        diagnosis, trial = self._tried(subject, call, tries, seed, budget, "")
        fields: dict[str, Any] = trial.to_dict()
        del fields["branch"]
        changes = [TriedChangeAnswer(**change) for change in fields.pop("changes")]
        return ChangesTried(
            subject=diagnosis.failure.subject, why=diagnosis.text, changes=changes, **fields
        )

    @method(effect="writes", scope="write")
    def keep_change(
        self,
        subject: _Subject,
        branch: Annotated[str, MinLen(1), MaxLen(64)],
        call: Call,
        tries: _Tries = 5,
        seed: _Seed = 0,
        budget: _Budget = 30.0,
    ) -> BestChange:
        """Try as `try_changes`, and keep the best change that held on a branch of its own.

        Parameters
        ----------
        subject
            IRI of an attempt, a task, a step or a stored plan, or an object's IRI or name.
        branch
            Name of the branch, which can be queried, compared and dropped; the graph itself is not
            written.
        tries
            How many draws of the cause each change meets.
        seed
            Of the draws.
        budget
            Time after which no try begins; the rest is answered as not tried.
        """
        diagnosis, trial = self._tried(subject, call, tries, seed, budget, branch)
        text = f"{diagnosis.text}\n{trial.text}"
        return BestChange(holds=trial.holds, branch=trial.branch, text=text)

    def _tried(
        self, subject: str, call: Call, tries: int, seed: int, budget: float, keep: str
    ) -> tuple[Diagnosis, ChangeTrial]:
        # The physics engine is loaded with the first trial, not with every server.
        from simulate.tasks.trials import TrialOptions, require_keep, try_changes

        require_keep(keep)
        options = TrialOptions(tries, seed, budget, keep, call.caller)
        return try_changes(self.graph.trunk, subject, options, call.progress)
