"""The answer in words: why an object was chosen, or why none was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rtask.engine.memory.meaning import Meaning

if TYPE_CHECKING:
    from rtask.engine.context import Context

from rtask.engine.operations.resolution.candidates import MAX_CANDIDATES, ObjectCandidate
from rtask.engine.operations.resolution.messages import Reason

__all__ = ["find_reasons", "sentence", "undecided"]

_MAX_ELSEWHERE = 3


def find_reasons(
    context: Context,
    wanted: str,
    meant: Meaning,
    candidates: list[ObjectCandidate],
    excluded: set[str],
) -> list[Reason]:
    """Return why the request is not met, or why other objects were not chosen."""
    if not meant.senses:
        near = f"; did you mean {meant.suggestions[0]!r}?" if meant.suggestions else ""
        return [_reason("no_such_kind", f"{wanted!r} names no kind and no use of things{near}")]
    reasons = []
    seen = [candidate for candidate in candidates if candidate.is_seen]
    if not seen:
        text = f"{_asked(context, meant)}: nothing of that is seen"
        reasons.append(_reason("not_seen", text))
    for candidate in seen:
        if candidate.iri in excluded:
            reasons.append(_reason("excluded", f"{candidate.label} was not wanted", candidate))
        elif candidate.verdict.capability == "no":
            reasons.append(
                _reason(
                    candidate.verdict.code, f"{candidate.label} {candidate.verdict.text}", candidate
                )
            )
    unseen = [candidate for candidate in candidates if not candidate.is_seen]
    latest = sorted(unseen, key=lambda candidate: candidate.seen, reverse=True)
    reasons += [
        _reason("elsewhere", f"{candidate.label} {_last_seen(candidate)}", candidate)
        for candidate in latest[:_MAX_ELSEWHERE]
    ]
    if len(latest) > _MAX_ELSEWHERE:
        atleast = "at least " if len(candidates) >= MAX_CANDIDATES else ""
        text = (
            f"{atleast}{len(latest) - _MAX_ELSEWHERE} more are known and not seen; "
            "a longer seen_within_s takes those in that were"
        )
        reasons.append(_reason("elsewhere", text))
    if not candidates:
        reasons.append(_reason("none_known", f"{_asked(context, meant)}: the graph knows none"))
    return reasons


def undecided(context: Context, meant: Meaning, tried: int, untried: int) -> Reason:
    text = (
        f"{_asked(context, meant)}: of {tried + untried} seen, only the {tried} seen last were "
        "looked at; name those in view in objects, or give a shorter seen_within_s"
    )
    return _reason("not_decided", text)


def _last_seen(candidate: ObjectCandidate) -> str:
    if not candidate.seen:
        return "has never been looked at"
    by = f" by {candidate.seen_by}" if candidate.seen_by else ""
    clause = f"was seen at {candidate.seen[:19]}Z{by}"
    if candidate.place is None:
        return clause
    x, y, z, frame = (candidate.place[name] for name in ("x", "y", "z", "frame_id"))
    return f"{clause}, at ({x:.2f}, {y:.2f}, {z:.2f}) of {frame}"


def _reason(code: str, text: str, candidate: ObjectCandidate | None = None) -> Reason:
    return Reason(
        code=code,
        text=text,
        object=candidate.iri if candidate else "",
        label=candidate.label if candidate else "",
        value=candidate.verdict.value if candidate else None,
        limit=candidate.verdict.limit if candidate else None,
        seen=candidate.seen if candidate else "",
        seen_by=candidate.seen_by if candidate else "",
        place=candidate.place if candidate else None,
    )


def _asked(context: Context, meant: Meaning) -> str:
    """Return the request in the graph's words: ``a cup to drink from, red``."""
    kinds = [
        " or ".join(f"a {context.classes.get(term).label}" for term in sense.terms)
        for sense in meant.senses
        if sense.kind == "class"
    ]
    uses = [
        "to " + " or ".join(context.functions.all()[term][0] for term in sense.terms)
        for sense in meant.senses
        if sense.kind == "function"
    ]
    looks = [
        ", " + " or ".join(names.all()[term][0] for term in sense.terms)
        for kind, names in (("trait", context.traits), ("colour", context.colours))
        for sense in meant.senses
        if sense.kind == kind
    ]
    says = [f' that says "{sense.words}"' for sense in meant.senses if sense.kind == "print"]
    return " ".join([" and ".join(kinds) or "something", *uses]) + "".join([*looks, *says])


def sentence(
    context: Context, meant: Meaning, best: ObjectCandidate | None, reasons: Sequence[Reason]
) -> str:
    """Return the answer in words."""
    if best is None:
        return "; ".join(reason.text for reason in reasons)
    chance = "no grasp of it is known yet"
    if best.chance is not None:
        chance = f"its surest grasp holds with a chance of {best.chance:.2f}"
    chosen = f"{best.label} is {_asked(context, meant)}; it {best.verdict.text}; {chance}"
    over = f"; not understood: {', '.join(meant.ignored)}" if meant.ignored else ""
    return chosen + over
