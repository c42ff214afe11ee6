"""What all looks for faults in the patterns of a query share."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.asking.check.fitting import Fitting
from rtask.asking.check.naming.names import words_of
from rtask.asking.check.repairs import Repairs
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import Context, Demand
from rtask.asking.check.vocabulary import local

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

    def _is_named_after_matches(self, demand: Demand) -> bool:
        """Return whether a variable has a word of the class of something that it stands for here.

        ``?ontology`` is fine for a named graph where the graph has that of ontologies.
        """
        words = words_of(demand.node.name)
        kinds = self._evidence.kinds_at(demand.edge, demand.at, self._vocabulary)
        return any(word in words for kind in kinds for word in words_of(local(kind)))

    def _patterns(self, context: Context) -> Iterator[Edge]:
        """Yield the patterns with one property and no fault so far."""
        for edge in context.own:
            if id(edge) not in self._blamed and len(edge.steps) == 1 and not edge.is_loose:
                yield edge
