"""Names of the parameters in a request."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from endpoint.http.messages import RefusedError

__all__ = ["refuse_unknown"]

# SPARQLWrapper and others send these beside the Accept header, which says the same and counts.
_OF_CLIENTS = ("format", "output", "results")


def refuse_unknown(names: Iterable[str], allowed: Sequence[str]) -> None:
    """Refuse a parameter without a meaning here: ignored, it would seem to have had its effect.

    Parameters
    ----------
    names
        Those of the request.
    allowed
        Those that the address understands.

    Raises
    ------
    RefusedError
        400 with the name, and the one that was probably meant.
    """
    for name in names:
        if name not in allowed and name not in _OF_CLIENTS:
            near = difflib.get_close_matches(name, allowed, 1)
            hint = f"did you mean `{near[0]}`? " if near else ""
            raise RefusedError(
                400,
                "usage",
                f"unknown parameter `{name[:80]}`; {hint}There are {', '.join(allowed)}",
                parameter=name[:80],
            )
