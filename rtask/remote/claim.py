"""The right to commit, which one process at a time has.

Some servers carry out updates side by side: each reads what was there before both, so that a
condition in an update does not keep another process from committing at the same moment. Oxigraph
and Virtuoso, as they are installed, are among them. A process therefore writes down its claim
first, and then looks: whoever sees the claim of another withdraws and tries again later. Two
processes cannot both miss each other, because each looks after its own claim is stored (Lamport
1974, "A New Solution of Dijkstra's Concurrent Programming Problem"). All this takes of a server is
that a query sees every update that was acknowledged before it.

A claim that a killed process left behind is removed once others have waited for it for as long as
its commit may take. Each of them counts from when it first saw the claim, and writes down, by the
server's clock, that it waits: programs that end before they have waited long enough hand on how
long they did.
"""

from __future__ import annotations

import contextlib
import random
import secrets
import time
from collections.abc import Callable
from datetime import datetime
from typing import Any

from pyoxigraph import Literal

from rtask.errors import RemoteUnavailableError, RtaskError
from rtask.remote.endpoints import Endpoints

__all__ = ["Claim", "server_time"]

_CLAIM = "<urn:rtask:store:claim>"
_WAITED = "<urn:rtask:store:waited>"
_NOTED_S = 1.0
"""How long a process waits for a claim before it writes down that it does."""
_BACK_OFF_S = (0.01, 0.1)
_LONGEST_S = 5.0


class Claim:
    """Claims of one process, identified by a random name.

    Parameters
    ----------
    name
        Graph in which claims are stored, in angle brackets.
    """

    def __init__(self, endpoints: Endpoints, name: str) -> None:
        self._endpoints = endpoints
        self._name = name
        self._process = secrets.token_hex(6)
        self._number = 0
        self._patience_s = 0
        self._seen: dict[str, float] = {}
        self._unsure = ""
        self._taken_at = float("-inf")
        self._has_waited = False

    @property
    def pattern(self) -> str:
        """Pattern of the present claim, for the request that depends on it."""
        return self._of(self._text)

    @property
    def _text(self) -> str:
        return f"{self._process}:{self._number}:{self._patience_s}"

    @property
    def age_s(self) -> float:
        """Seconds since others can have seen the claim, at most."""
        return time.monotonic() - self._taken_at

    def _of(self, claim: str) -> str:
        return f"GRAPH {self._name} {{ {self._name} {_CLAIM} {Literal(claim)} }}"

    def take(self, and_read: str, check: Callable[[list[Any]], None], patience_s: int) -> None:
        """Wait until no other process commits, and keep others from it.

        Parameters
        ----------
        patience_s
            Seconds that a server may need for the commit. Others then take the claim for one of a
            process that has ended, and remove it.
        and_read
            Pattern with the variable ``?h``, which is asked for in the same query.
        check
            Is given the values of ``?h``; an error it raises withdraws the claim.

        Raises
        ------
        RemoteUnavailableError
            The server does not answer, or other processes held the right all the time.
        """
        self._patience_s = patience_s
        end = time.monotonic() + self._endpoints.connection.timeout_s
        everybody = f"GRAPH {self._name} {{ {self._name} {_CLAIM} ?c }}"
        failure: RemoteUnavailableError | None = None
        while True:
            others: list[str] = []
            # Others count from when they first saw a text: no claim may look like an earlier one.
            self._number += 1
            began = time.monotonic()
            try:
                self._endpoints.update(f"INSERT DATA {{ {self.pattern} }}")
                rows = self._endpoints.rows(
                    f"SELECT ?h ?c {{ {{ {and_read} }} UNION {{ {everybody} }} }}"
                )
                failure = None
                claims = [c.value for _, c in rows if c is not None]
                others = self._others(claims)
                if not others and self._text in claims:  # others remove one that came too late
                    check([h for h, _ in rows if h is not None])
                    self._taken_at = began
                    self._forget_waiting()
                    return
                self.release()
            except RemoteUnavailableError as error:
                failure = error
            except BaseException:
                self.release()
                raise
            if time.monotonic() >= end:
                raise RemoteUnavailableError(
                    f"{self._endpoints} does not answer"
                    if failure
                    else f"{self._endpoints}: commits that have not ended kept this one waiting "
                    f"for {self._endpoints.connection.timeout_s:g} s; nothing was stored, try again"
                ) from failure
            # On a slow server, claims that are stored for longer must be further apart.
            shortest, longest = _BACK_OFF_S
            apart = 2 * len(others) * (time.monotonic() - began)
            time.sleep(random.uniform(shortest, min(max(longest, apart), _LONGEST_S)))

    def _others(self, claims: list[str]) -> list[str]:
        """Return the claims of other processes, without those that ended processes left behind."""
        now = time.monotonic()
        self._seen = {claim: self._seen.get(claim, now) for claim in claims if claim != self._text}
        others = []
        for claim, since in self._seen.items():
            process, patience_s = _read(claim)
            is_over = process == self._process and claim != self._unsure
            waited_s = now - since
            if not is_over and _NOTED_S < waited_s <= patience_s:
                waited_s = max(waited_s, self._waited_s(claim))
            if is_over or waited_s > patience_s:
                self._endpoints.update(f"DELETE DATA {{ {self._of(claim)} }}")
            else:
                others.append(claim)
        return others

    def _waited_s(self, claim: str) -> float:
        """Return how long any process has waited for a claim; write down that this one does."""
        self._has_waited = True
        mark = f"GRAPH {self._name} {{ {self._name} {_WAITED} ?m }}"
        start = Literal(claim + " ")
        rows = self._endpoints.rows(
            f"SELECT ?m (STR(NOW()) AS ?now) {{ {mark} FILTER(STRSTARTS(STR(?m), {start})) }}"
        )
        if not rows:
            now = f"BIND(CONCAT({start}, STR(NOW())) AS ?m)"
            self._endpoints.update(f"INSERT {{ {mark} }} WHERE {{ {now} }}")
        waited = 0.0
        for began, now in rows:
            with contextlib.suppress(ValueError):  # written by somebody else
                since = server_time(began.value[len(claim) + 1 :])
                waited = max(waited, (server_time(now.value) - since).total_seconds())
        return waited

    def _forget_waiting(self) -> None:
        if not self._has_waited:
            return
        self._has_waited = False
        with contextlib.suppress(RtaskError):
            self._endpoints.update(
                f"DELETE WHERE {{ GRAPH {self._name} {{ {self._name} {_WAITED} ?m }} }}"
            )

    def keep(self) -> None:
        """Leave the claim, also to this process, because its commit may still be stored."""
        self._unsure = self._text
        self._seen[self._text] = self._taken_at

    def release(self) -> None:
        """Withdraw the claim; one that cannot be withdrawn now is with the next one."""
        with contextlib.suppress(RtaskError):
            self._endpoints.update(f"DELETE DATA {{ {self.pattern} }}")


def _read(claim: str) -> tuple[str, int]:
    """Return the process of a claim and its patience, s; what is no claim has none.

    Examples
    --------
    >>> _read("5f3a:7:600"), _read("something else")
    (('5f3a', 600), ('something else', 0))
    """
    process, _, rest = claim.partition(":")
    patience = rest.rpartition(":")[2]
    return process, int(patience) if patience.isdecimal() else 0


def server_time(text: str) -> datetime:
    """Return a time without its zone: all of them are one server's."""
    return datetime.fromisoformat(text).replace(tzinfo=None)
