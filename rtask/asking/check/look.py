"""What all looks for faults in the patterns of a query share."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.asking.check.fitting import Fitting
from rtask.asking.check.repairs import Repairs
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import Context

__all__ = ["Look"]


class Look:
    """A look for faults of one sort.

    Parameters
    ----------
    fitting
        Of the query.
    repairs
        Of the query.
    blamed
        Numbers (``id``) of the patterns that have a fault; all looks at one query share them.
    """

    def __init__(self, fitting: Fitting, repairs: Repairs, blamed: set[int]) -> None:
        self._fitting = fitting
        self._vocabulary = fitting.vocabulary
        self._evidence = fitting.evidence
        self._repairs = repairs
        self._blamed = blamed

    def _patterns(self, context: Context) -> Iterator[Edge]:
        """Yield the patterns with one property and no fault so far."""
        for edge in context.own:
            if id(edge) not in self._blamed and len(edge.steps) == 1 and not edge.is_loose:
                yield edge
