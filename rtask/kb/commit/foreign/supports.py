"""Supports: the asserted statements on which a contradiction or an identity rests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rtask.rdf.terms import Term, TripleKey

__all__ = ["Support", "leaves_of", "support_of"]


@dataclass(frozen=True)
class Support:
    """What leads to a contradiction or an identity.

    Parameters
    ----------
    statements
        Asserted statements.
    unproven
        Terms of derived statements of which no proof was found within the reasoner's budget.
    """

    statements: tuple[TripleKey, ...]
    unproven: tuple[Term, ...] = ()


def support_of(clash: Any) -> Support:
    """Return what is behind a :class:`reasoner.Contradiction`."""
    terms = () if clash.is_proven else (t for triple in clash.triples for t in triple[::2])
    return Support(tuple(clash.culprits()), tuple(dict.fromkeys(terms)))


def leaves_of(proof: Any) -> Support:
    """Return the asserted statements of a :class:`reasoner.Proof`."""
    return Support(tuple(dict.fromkeys(proof.leaves())))
