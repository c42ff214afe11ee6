"""Which operations may be sent again, which may wait, and what identifies a report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rtask.wire.request_id import RequestId

__all__ = ["CallRules"]


@dataclass(frozen=True)
class CallRules:
    """What follows for callers from the declarations of the operations.

    Parameters
    ----------
    repeatable
        Operations that may be sent again after a connection was lost.
    deferrable
        Operations that may wait in an outbox.
    request_ids
        Where requests carry the ids by which they are stored once.

    Examples
    --------
    >>> rules = CallRules(frozenset({"where_is"}), frozenset(), {"report": RequestId("task_id")})
    >>> CallRules.from_json(rules.as_json()) == rules
    True
    """

    repeatable: frozenset[str]
    deferrable: frozenset[str]
    request_ids: Mapping[str, RequestId]

    def as_json(self) -> dict[str, Any]:
        """Return the rules as an object of JSON, which :meth:`from_json` reads."""
        return {
            "repeatable": sorted(self.repeatable),
            "deferrable": sorted(self.deferrable),
            "request_ids": {name: asdict(ids) for name, ids in self.request_ids.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CallRules:
        """Return the rules that :meth:`as_json` wrote."""
        ids = {
            name: RequestId(
                given["field"],
                given["entries"],
                None if given["where"] is None else (given["where"][0], given["where"][1]),
            )
            for name, given in data["request_ids"].items()
        }
        return cls(frozenset(data["repeatable"]), frozenset(data["deferrable"]), ids)
