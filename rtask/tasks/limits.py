"""Limits of a plan: who alone may do its steps, who may not, and what may not be touched.

They hold for all that is done for a goal: for the plan, for every plan that is made of it again,
and for what only helps, such as putting aside what is in the way.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select

__all__ = ["MAX_LIMITED", "Limits", "limited", "read_limits"]

MAX_LIMITED = 2000
"""Most IRIs of one limit."""
_IRI = re.compile(r"[^\s<>\"{}|\\^`]+")
_WHAT = {
    "by": "robots", "not_by": "robots", "untouched": "things", "only_touch": "things",
}  # fmt: skip


@dataclass(frozen=True)
class Limits:
    """Limits of a goal, as IRIs.

    Parameters
    ----------
    by
        Robots that alone are to do it; empty for all.
    not_by
        Robots that do nothing for it.
    untouched
        Things that no step may be about.
    only_touch
        Things that alone steps may be about; None for all.
    """

    by: tuple[str, ...] = ()
    not_by: tuple[str, ...] = ()
    untouched: tuple[str, ...] = ()
    only_touch: tuple[str, ...] | None = None

    def __bool__(self) -> bool:
        return bool(self.by or self.not_by or self.untouched or self.only_touch is not None)

    def __or__(self, other: Limits) -> Limits:
        """Return what keeps to both."""
        allowed = [item.only_touch for item in (self, other) if item.only_touch is not None]
        only = tuple(sorted(set(allowed[0]).intersection(*allowed))) if allowed else None
        by = sorted(set(self.by) & set(other.by)) if self.by and other.by else self.by or other.by
        if self.by and other.by and not by:
            raise UsageError("two robots are each said to do it alone")
        return Limits(
            tuple(by), tuple(sorted({*self.not_by, *other.not_by})),
            tuple(sorted({*self.untouched, *other.untouched})), only,
        )  # fmt: skip

    def to_dict(self) -> dict[str, list[str]]:
        """Return the members that a goal in JSON has for them."""
        values = {name: getattr(self, name) for name in _WHAT}
        return {
            name: list(value) for name, value in values.items()
            if value or (name == "only_touch" and value is not None)
        }  # fmt: skip

    @property
    def of_help(self) -> Limits:
        """What also holds for steps that only clear the way: others may do these."""
        return replace(self, by=())

    def current(self, select: Select) -> Limits:
        """Return them with the things that those meant have turned out to be."""
        things = {*self.untouched, *(self.only_touch or ())}
        if not things:
            return self
        nodes = " ".join(str(NamedNode(iri)) for iri in sorted(things))
        rows = select(
            f"{PREFIXES}SELECT DISTINCT ?was ?into WHERE {{ VALUES ?was {{ {nodes} }} "
            f"?was rt:mergedInto+ ?into }} LIMIT {MAX_LIMITED}"
        )
        into: dict[str, set[str]] = {}
        for row in rows:
            into.setdefault(str(row.value("was")), set()).add(str(row.value("into")))

        def now(iris: Iterable[str]) -> tuple[str, ...]:
            return tuple(sorted({new for iri in iris for new in (iri, *into.get(iri, ()))}))

        only = None if self.only_touch is None else now(self.only_touch)
        return replace(self, untouched=now(self.untouched), only_touch=only)


def read_limits(given: str | Mapping[str, Any]) -> Limits:
    """Return the limits of a goal in JSON; none for words.

    Raises
    ------
    UsageError
        One of them is no list of IRIs.

    Examples
    --------
    >>> read_limits({"achieve": "<urn:pen> rt:locatedOn <urn:box>", "by": ["urn:nao"]}).by
    ('urn:nao',)
    """
    if isinstance(given, str):
        given = json.loads(given) if given.lstrip().startswith("{") else {}
    if not isinstance(given, Mapping):
        return Limits()
    return Limits(
        _iris(given, "by"), _iris(given, "not_by"), _iris(given, "untouched"),
        _iris(given, "only_touch") if given.get("only_touch") is not None else None,
    )  # fmt: skip


def limited(pattern: str, given: str) -> str:
    """Return a pattern as a goal that keeps to the limits of another one, for what helps it.

    Parameters
    ----------
    given
        The other goal: JSON that may have limits, or words, which have none that are settled.

    Examples
    --------
    >>> limited("<urn:cup> rt:locatedOn <urn:box>", '{"goals": [], "untouched": ["urn:jug"]}')
    '{"achieve": "<urn:cup> rt:locatedOn <urn:box>", "untouched": ["urn:jug"]}'
    """
    limits = read_limits(given).of_help
    return json.dumps({"achieve": pattern, **limits.to_dict()}) if limits else pattern


def _iris(given: Mapping[str, Any], name: str) -> tuple[str, ...]:
    value = given.get(name, [])
    if not isinstance(value, list) or len(value) > MAX_LIMITED or not all(
        isinstance(item, str) and _IRI.fullmatch(item) for item in value
    ):  # fmt: skip
        raise UsageError(f'"{name}" of a goal is a list of IRIs of {_WHAT[name]}')
    return tuple(value)
