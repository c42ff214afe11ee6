"""Effect of a call on the graph: none, a record that the answer does not wait for, or a change.

A right says who may call; an effect says what happens. It is declared beside the right, in one
word, for each operation, method of a service, address and command. Followers, retries, races,
caches, tools of agents, OpenAPI and the audit trail go by this word, and by nothing else.
"""

from __future__ import annotations

from typing import Final, Literal, get_args

__all__ = ["EFFECTS", "Effect", "Source", "strongest"]

Effect = Literal["reads", "records", "writes"]
"""``reads``: commits nothing. ``records``: answers from what is there, and then stores that it was
asked, seen or refused; the answer does not depend on that record. ``writes``: everything else.
"""

Source = Literal["graph", "reasoner", "writer"]
"""What an answer is made from. ``graph``: statements and history, which followers copy.
``reasoner``: proofs and rules, which those servers have that derive statements themselves.
``writer``: what the server that takes writes has alone.
"""

EFFECTS: Final[tuple[Effect, ...]] = get_args(Effect)
"""All effects, the weakest first."""


def strongest(*effects: Effect) -> Effect:
    """Return the effect of work that consists of several parts.

    >>> strongest("reads", "writes", "records"), strongest()
    ('writes', 'reads')
    """
    return max(effects, key=EFFECTS.index, default="reads")
