"""Query plans: the parts of an object query before it is compiled."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import ontology
from rtask.errors import UsageError
from rtask.model.instance import Model, Property
from rtask.model.query.expressions import Condition, Order, Path, root, steps
from rtask.rdf.terms import NamedNode, prologue

__all__ = ["Plan", "check_root", "finished", "short"]

_LOCAL = re.compile(r"[A-Za-z_]\w*")
_PREFIXED = re.compile(rf"\b({'|'.join(ontology.PREFIXES)}):")


@dataclass(frozen=True)
class Plan:
    """Parts of an object query before it is compiled.

    Parameters
    ----------
    model
        The class of the roots.
    conditions
        One tuple per call of ``where``; within a call, equal paths refer to the same value.
    inferred
        Whether derived statements are visible; if not, subclasses and inverses are spelled out.
    """

    model: type[Model]
    conditions: tuple[tuple[Condition, ...], ...] = ()
    orders: tuple[Order, ...] = ()
    limit: int | None = None
    offset: int = 0
    prefetch: tuple[tuple[Property, ...], ...] = ()
    inferred: bool = True

    def following(self, path: Sequence[Property]) -> list[Property]:
        """Return the next steps of the prefetched paths that begin with this one."""
        longer = [p for p in self.prefetch if p[: len(path)] == tuple(path) != p]
        return list(dict.fromkeys(p[len(path)] for p in longer))


@lru_cache(maxsize=4096)
def short(iri: str) -> str:
    """Return an IRI as written in a query, abbreviated with a prefix if possible.

    >>> short(ontology.NS + "mass"), short("urn:mug")
    ('rt:mass', '<urn:mug>')
    """
    for name, namespace in ontology.PREFIXES.items():
        if iri.startswith(namespace) and _LOCAL.fullmatch(iri[len(namespace) :]):
            return f"{name}:{iri[len(namespace) :]}"
    return str(NamedNode(iri))


def finished(text: str) -> str:
    """Return a query with declarations of the prefixes that it uses."""
    used = set(_PREFIXED.findall(text))
    return prologue({name: iri for name, iri in ontology.PREFIXES.items() if name in used}) + text


def check_root(plan: Plan, path: Path[Any]) -> tuple[Property, ...]:
    """Return the fields of a path, which must begin at the class of the query.

    Raises
    ------
    UsageError
        If it begins elsewhere, or is no path at all.
    """
    if not isinstance(path, Path):
        raise UsageError(
            f"expected a path such as {plan.model.__name__}.name_of_a_field, not {path!r}"
        )
    if not (issubclass(plan.model, root(path)) or issubclass(root(path), plan.model)):
        raise UsageError(f"{path!r} does not begin at {plan.model.__name__}")
    return steps(path)
