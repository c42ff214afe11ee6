"""Contributors: how far their reports agree, and the withdrawal of one by a person."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Annotated, Literal
from urllib.parse import unquote

from annotated_types import Ge, Le

from rtask.engine.curation.period import LATEST_S
from rtask.engine.curation.withdrawing import withdraw
from rtask.engine.honesty import Honesty
from rtask.engine.names import tail
from rtask.engine.operations.curate import author_of
from rtask.engine.operations.operation import operation
from rtask.rdf.terms import iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Number, Text, Unit

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = [
    "CompareContributors",
    "ComparedContributors",
    "Contributor",
    "WithdrawContributor",
    "WithdrawnContributor",
    "compare_contributors",
    "withdraw_contributor",
]

_DOUBTFUL = 0.5


class CompareContributors(Message):
    """Request to compare robots' reports."""

    contributor: Text | None = None
    """name of one robot; default: all"""


class Contributor(Answer):
    """Reports of a robot, and their agreement with others' reports on the same grasps."""

    name: str
    attempts: int
    """reports that say something about a grasp"""
    comparable: int
    """reports on grasps that other robots have tried with the same kind of hand"""
    agreement: float | None
    """share of these that say what most of the others say; none if nothing is comparable"""
    interval95: list[float]
    """exact (Clopper-Pearson) interval of the agreement; empty if nothing is comparable"""
    truthful: float
    """probability that it reports truthfully"""
    manner: str
    """most probable manner of reporting"""
    weight: float
    """part for which each of its reports counts when other robots choose, 0..1"""
    finding: Literal["agrees", "doubtful", "contradicts"]
    """contradicts: almost surely not truthful, so that choices leave its reports out"""
    text: str


class ComparedContributors(Answer):
    """Contributors, the least truthful first."""

    contributors: list[Contributor]


@operation("read", "reads", "tell how far the reports of each robot agree with those of the others")
def compare_contributors(
    context: Context, request: CompareContributors, access: Access
) -> ComparedContributors:
    """Compare what robots reported of the same grasps, verdicts of people left aside."""
    del access
    honesties = sorted(context.honesty.now().values(), key=lambda h: (h.truthful, h.robot))
    return ComparedContributors(
        contributors=[
            _contributor(honesty)
            for honesty in honesties
            if request.contributor in (None, _name(honesty))
        ]
    )


def _name(honesty: Honesty) -> str:
    return unquote(tail(iri(honesty.robot)))


def _contributor(honesty: Honesty) -> Contributor:
    finding: Literal["agrees", "doubtful", "contradicts"] = "agrees"
    if honesty.truthful < _DOUBTFUL:
        finding = "contradicts" if honesty.contradicts else "doubtful"
    n, name = honesty.comparable, _name(honesty)
    share = honesty.agreeing / n if n else None
    return Contributor(
        name=name,
        attempts=honesty.attempts,
        comparable=n,
        agreement=share,
        interval95=_interval(honesty.agreeing, n) if n else [],
        truthful=honesty.truthful,
        manner=honesty.manner,
        weight=0.0 if honesty.contradicts else honesty.weight,
        finding=finding,
        text=f"{name}: {_text(honesty, finding)}",
    )


def _interval(k: float, n: int) -> list[float]:
    """Return the Clopper-Pearson interval of k of n; ties make k a multiple of one half."""
    from scipy.special import betaincinv

    low = float(betaincinv(k, n - k + 1, 0.025)) if k > 0 else 0.0
    high = float(betaincinv(k + 1, n - k, 0.975)) if k < n else 1.0
    return [low, high]


def _text(honesty: Honesty, finding: str) -> str:
    if not honesty.comparable:
        return "nobody else has tried what it tried"
    agree = (
        f"{honesty.agreeing:g} of {honesty.comparable} comparable reports agree with the others'"
    )
    counts = f"; each counts {honesty.weight:.2f} for others"
    if finding == "agrees":
        return agree if honesty.weight == 1 else agree + counts
    if finding == "contradicts":
        counts = "; none counts for others"
    return f"only {agree}; it seems to report {honesty.manner}{counts}"


class WithdrawContributor(Message):
    """A contributor whose word no longer counts."""

    contributor: Text
    """name of the robot or person"""
    operator: Text | None = None
    """name of the person who withdraws it; default: the caller"""
    since: Annotated[Number, Unit("s"), Ge(0), Le(LATEST_S)] | None = None
    """Unix time: only what was stored from then on; default: all"""
    until: Annotated[Number, Unit("s"), Ge(0), Le(LATEST_S)] | None = None
    """Unix time: only what was stored before; default: all"""


class WithdrawnContributor(Answer):
    """Statements that were withdrawn, and the commit, which can be undone."""

    commit: str
    attempts: int
    """attempts that it had reported"""
    verdicts: int
    """verdicts that it had given on attempts of others"""
    objects: int
    """objects that it had added and nobody else has handled"""
    kept: int
    """objects that it had added and that stay, because others build on them"""
    grasps: int
    """grasps whose belief is restated from what the others reported"""
    added: int
    removed: int


@operation(
    "teach",
    "writes",
    "withdraw all that a robot or a person reported, and all that followed from it",
)
def withdraw_contributor(
    context: Context, request: WithdrawContributor, access: Access
) -> WithdrawnContributor:
    """Withdraw a contributor, or a period of it, in one commit; robots may not."""
    author = author_of(context, request.operator, access)
    since, until = (
        None if time is None else dt.datetime.fromtimestamp(time, dt.UTC)
        for time in (request.since, request.until)
    )  # fmt: skip
    done = withdraw(context, request.contributor, author, since, until)
    return WithdrawnContributor(
        commit=context.commit_id(done.commit),
        attempts=done.attempts,
        verdicts=done.verdicts,
        objects=done.objects,
        kept=done.kept,
        grasps=done.grasps,
        added=done.commit.added,
        removed=done.commit.removed,
    )
