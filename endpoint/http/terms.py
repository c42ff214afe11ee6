"""Terms of RDF in requests."""

from __future__ import annotations

from pyoxigraph import RdfFormat, parse

import ontology
from rtask.errors import RtaskError, UsageError
from rtask.rdf.terms import Term, iri, stored

__all__ = ["read_term"]


def read_term(text: str, name: str) -> Term:
    """Return a term written as a plain IRI, with a prefix of the ontology, or as in N-Triples.

    Parameters
    ----------
    name
        Of the field, for the error.

    Examples
    --------
    >>> str(read_term("urn:mug", "s")), str(read_term('"red"@en', "o"))
    ('<urn:mug>', '"red"@en')
    >>> read_term("rdf:type", "p")
    <NamedNode value=http://www.w3.org/1999/02/22-rdf-syntax-ns#type>

    Raises
    ------
    UsageError
        It is none of these.
    """
    try:
        if text[:1] not in ("<", '"'):
            prefix, colon, local = text.partition(":")
            namespace = ontology.PREFIXES.get(prefix) if colon else None
            return iri(text if namespace is None else namespace + local)
        (triple,) = parse(f"<urn:s> <urn:p> {text} .".encode(), format=RdfFormat.N_TRIPLES)
        return stored(triple.object)
    except (RtaskError, ValueError, SyntaxError) as error:
        raise UsageError(
            f"{name}: expected an IRI or a term in N-Triples syntax, got {text[:100]!r}: {error}"
        ) from None
