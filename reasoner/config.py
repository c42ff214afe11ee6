"""Bounds and policies of a closure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from reasoner.contradictions import Contradiction

__all__ = ["Config", "InconsistentError"]


class InconsistentError(ValueError):
    """A change contradicts known statements, and the configuration rejects such changes."""

    def __init__(self, contradictions: list[Contradiction]) -> None:
        more = len(contradictions) - 1
        super().__init__(contradictions[0].message + (f" (and {more} more)" if more else ""))
        self.contradictions = contradictions


@dataclass(frozen=True, slots=True)
class Config:
    """Bounds and policies of a closure.

    Attributes
    ----------
    on_contradiction : {"report", "reject"}
        Whether `stage` lists new contradictions or raises `InconsistentError`.
    ill_typed : {"reject", "keep"}
        Whether `"abc"^^xsd:integer` is a contradiction or an opaque value.
    max_inferred : int
        Bound on derived facts, above 50 per asserted one.
    max_joins : int
        Bound on the combinations of facts that the rules may try in one change, above 20 for each
        asserted fact.
    bulk_from : int
        Size of a change from which consequences are derived by joins of whole relations; for an
        empty closure, a tenth of it.
    owner : callable, optional
        Returns who named a thing, of its IRI; None for names of nobody. A key makes no two things
        of different owners one. Equal ones decide alike.
    """

    on_contradiction: str = "report"
    ill_typed: str = "reject"
    max_inferred: int = 1_000_000
    max_joins: int = 1_000_000
    bulk_from: int = 2_000
    owner: Callable[[str], str | None] | None = None

    def __post_init__(self) -> None:
        if self.on_contradiction not in ("report", "reject"):
            raise ValueError(
                f"on_contradiction is 'report' or 'reject', not {self.on_contradiction!r}"
            )
        if self.ill_typed not in ("reject", "keep"):
            raise ValueError(f"ill_typed is 'reject' or 'keep', not {self.ill_typed!r}")
