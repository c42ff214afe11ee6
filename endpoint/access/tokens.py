"""Access tokens: ``rtk_<id>_<secret>``, kept as digests in ``tokens.sqlite``.

The file is in the data folder, with mode 0600. A secret is shown once, when the token is created;
only its SHA-256 is kept, and compared in constant time. Any process may create or revoke tokens;
whether the file has changed is checked every half second, so that a revocation by another process
takes effect within that time, and one by this process at once.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import math
import os
import re
import secrets
import sqlite3
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import cast

from endpoint.http.messages import RefusedError
from rtask.errors import AuthenticationError, StoreError, StoreFormatError, UsageError
from rtask.kb.commit.access import Access, Role

FILE_NAME = "tokens.sqlite"
ROLES = ("reader", "robot", "teacher", "admin")
_TOKEN = re.compile(r"rtk_([0-9a-f]{12})_([0-9a-f]{32})")
_AGENT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_LOOK_EVERY_S = 0.1
CHECK_EVERY_S = 0.5
_STANDS_S = 0.05
_MAX_REMEMBERED = 10_000
Row = tuple[str, bytes, str | None, str, str, str | None, str | None, str | None]
_SCHEMA = """
CREATE TABLE IF NOT EXISTS tokens (
    id TEXT PRIMARY KEY,
    digest BLOB NOT NULL,
    agent TEXT,
    role TEXT NOT NULL,
    created TEXT NOT NULL,
    expires TEXT,
    revoked TEXT,
    rights TEXT
) STRICT
"""
_COLUMNS = frozenset(("id", "digest", "agent", "role", "created", "expires", "revoked"))
_LOOK = """
SELECT EXISTS (SELECT 1 FROM tokens),
       EXISTS (SELECT 1 FROM tokens WHERE ' ' || rights LIKE '% read:%')
"""


@dataclass(frozen=True)
class Token:
    """A token without its secret.

    Parameters
    ----------
    id
        Twelve hex digits; public.
    agent
        Robot or person to whom the token belongs; none for readers and administrators.
    role
        ``reader``, ``robot``, ``teacher`` or ``admin``.
    created, expires, revoked
        ISO 8601, UTC; the last two may be missing.
    rights
        What the token allows beyond its role, or the graphs to which it is limited; see
        :class:`rtask.kb.commit.access.Access`.
    """

    id: str
    agent: str | None
    role: str
    created: str
    expires: str | None = None
    revoked: str | None = None
    rights: tuple[str, ...] = ()

    @cached_property
    def access(self) -> Access:
        """The rights that the token grants."""
        return Access(self.agent, cast(Role, self.role), frozenset(self.rights))

    @cached_property
    def expires_at(self) -> float:
        """Time of expiry, in seconds since 1970."""
        if self.expires is None:
            return math.inf
        return datetime.fromisoformat(self.expires).timestamp()

    def is_valid(self, now: float) -> bool:
        """Tell whether the token is neither revoked nor expired at a time since 1970 (s)."""
        return not self.revoked and self.expires_at > now


class TokenStore:
    """The tokens of one data folder.

    Parameters
    ----------
    folder
        Data folder; none to keep the tokens in memory, for a server without a folder.
    clock
        Returns seconds; tests pass their own.

    Examples
    --------
    >>> tokens = TokenStore(None)
    >>> text, token = tokens.create("robot", agent="nao-1")
    >>> tokens.authenticate(text).agent
    'nao-1'
    >>> tokens.revoke(token.id)
    True
    >>> tokens.authenticate(text)
    Traceback (most recent call last):
    rtask.errors.AuthenticationError: token ... was revoked; ask for a new one
    """

    def __init__(self, folder: Path | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._path = folder / FILE_NAME if folder else None
        self._lock = threading.Lock()
        self._local = threading.local()
        self._open: list[sqlite3.Connection] = []
        self._memory: sqlite3.Connection | None = None
        self._ever_issued = False
        self._ever_limited = False
        self._look_again = 0.0
        self._tokens: dict[bytes, Token] = {}
        self._cached_at = b""
        self._memory_version = 0
        self._handle = -1
        self._clock = clock
        self._file_version = b""
        self._standing = (b"", False, False)
        self._check_again = self._stands_until = -math.inf
        self.is_current: Callable[[], bool] = lambda: True
        """Whether revocations still arrive here; a follower out of contact lets no token in."""
        if self._path:
            # Created with the right mode before SQLite opens it, so it is never readable by others.
            self._path.touch(mode=0o600, exist_ok=True)
            self._path.chmod(0o600)
        else:
            self._memory = sqlite3.connect(":memory:", check_same_thread=False)
            self._open.append(self._memory)
        try:
            self._prepare()
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):  # locked, or no room
                raise StoreError(f"{self._path} cannot be used: {error}") from error
            raise StoreFormatError(
                f"{self._path} is damaged: {error}; restore it from a backup, or remove it and "
                "create the tokens anew: rtask token create",
                damaged="tokens",
            ) from error
        if self._path:
            self._handle = os.open(self._path, os.O_RDONLY)

    def _prepare(self) -> None:
        """Create the table, or add what an earlier version's lacks."""
        with self._lock, self._connection() as connection:
            connection.execute(_SCHEMA)
            columns = {row[1] for row in connection.execute("PRAGMA table_info(tokens)")}
            if "rights" not in columns:
                connection.execute("ALTER TABLE tokens ADD COLUMN rights TEXT")
            if missing := _COLUMNS - columns:
                raise sqlite3.DatabaseError(f"its table has no {', '.join(sorted(missing))}")

    def create(
        self,
        role: str,
        *,
        agent: str | None = None,
        lifetime: timedelta | None = None,
        rights: Iterable[str] = (),
    ) -> tuple[str, Token]:
        """Create a token.

        Parameters
        ----------
        role
            One of :data:`ROLES`.
        agent
            Name of the robot or person; required for ``robot`` and ``teacher``.
        lifetime
            Time from now until it expires; none for a token that never does.
        rights
            What the token allows beyond its role, or the graphs to which it is limited; see
            :class:`rtask.kb.commit.access.Access`.

        Returns
        -------
        text, token
            The token itself, to be shown once, and its record.

        Raises
        ------
        UsageError
            The role or a right is unknown, or the name is missing or invalid.
        """
        if role not in ROLES:
            raise UsageError(f"unknown role {role!r}; one of {', '.join(ROLES)}")
        if agent is not None and not _AGENT.fullmatch(agent):
            raise UsageError(
                f"{agent!r} is not a valid name: use letters, digits, `.`, `_`, `-`; at most 64"
            )
        if agent is None and role in ("robot", "teacher"):
            raise UsageError(f"a token of role {role} needs the name of its {role}")
        now = datetime.now(UTC)
        expires = (now + lifetime).isoformat() if lifetime else None
        # In one order, so that equal rights are equal rows.
        granted = tuple(sorted(set(rights)))
        token = Token(secrets.token_hex(6), agent, role, now.isoformat(), expires, rights=granted)
        require_rights(token)
        secret = secrets.token_hex(16)
        with self._lock, self._connection() as connection:
            connection.execute(
                "INSERT INTO tokens (id, digest, agent, role, created, expires, rights)"
                " VALUES (?, ?, ?, ?, ?, ?, ?)",
                (token.id, _digest(secret), agent, role, token.created, expires, _joined(granted)),
            )
        self._ever_issued = True
        # Once one token is limited, a caller without one may no longer read everything.
        self._ever_limited |= token.access.reads is not None
        self._stands_until = -math.inf
        return f"rtk_{token.id}_{secret}", token

    def authenticate(self, text: str) -> Token:
        """Return the record of a token, given its text.

        Raises
        ------
        AuthenticationError
            Malformed, unknown, expired or revoked; the message never repeats the secret.
        RefusedError
            503: whether it was revoked is not known here.
        """
        self._require_current()
        shown, version = _digest(text), self._version()
        if version != self._cached_at:
            self._tokens, self._cached_at = {}, version
        # The dictionary of this version: another thread may begin a newer one meanwhile.
        tokens = self._tokens
        cached = tokens.get(shown)
        if cached is not None and cached.is_valid(time.time()):
            return cached
        token = self._look_up(text)
        # Bounded, since anybody may send texts that look like tokens.
        if len(tokens) < _MAX_REMEMBERED:
            tokens[shown] = token
        return token

    def _look_up(self, text: str) -> Token:
        match = _TOKEN.fullmatch(text)
        row = self._row(match.group(1)) if match else None
        # Compared even without a row, or the time taken would tell which ids exist.
        digest = row[1] if row else bytes(32)
        secret = match.group(2) if match else ""
        if not hmac.compare_digest(digest, _digest(secret)) or row is None:
            raise AuthenticationError("not a token of this server", token_sent=True)
        token = _token(row)
        if token.revoked:
            raise AuthenticationError(
                f"token {token.id} was revoked; ask for a new one", token_sent=True
            )
        if not token.is_valid(time.time()):
            raise AuthenticationError(
                f"token {token.id} expired at {token.expires}; ask for a new one", token_sent=True
            )
        return token

    def _require_current(self) -> None:
        if not self.is_current():
            raise RefusedError(
                503,
                "authority-lapsed",
                "this follower has been out of contact with its writer for so long that it does "
                "not know whether the token was revoked; ask the writer or another follower",
                headers=(("Retry-After", "5"),),
            )

    def is_valid(self, token_id: str) -> bool:
        """Return whether a token that was accepted before is known to be still valid."""
        return self.is_current() and self.get(token_id) is not None

    def get(self, token_id: str) -> Token | None:
        """Return a valid token by its id, without checking a secret; none if it is not valid.

        Raises
        ------
        RefusedError
            503: whether it was revoked is not known here.
        """
        self._require_current()
        row = self._row(token_id)
        token = _token(row) if row is not None else None
        if token is not None and token.is_valid(time.time()):
            return token
        # Whoever has learnt here that a token is void must not be let in by what is remembered.
        self._check_again = self._stands_until = -math.inf
        return None

    def _version(self) -> bytes:
        """Return a number that changes with every commit to the file, by whatever process.

        It is the "file change counter" of the SQLite file format (1.3.8), read by one system call
        every half second, which saves a look-up for each request.
        """
        if self._handle < 0:
            return self._memory_version.to_bytes(4, "big")
        now = self._clock()
        if now >= self._check_again:
            self._check_again = now + CHECK_EVERY_S
            # SQLite counts commits at this offset of its file, so no query is needed to see a
            # change.
            self._file_version = os.pread(self._handle, 4, 24)
        return self._file_version

    def revision(self) -> tuple[bytes, bool, bool]:
        """Return a value that differs once any token was created, revoked or changed.

        Whoever was identified while it was the same is identified likewise, until the token
        expires.
        """
        now = self._clock()
        if now >= self._stands_until:
            self._look()
            version = self._version() if self.is_current() else b""
            self._standing = (version, self._ever_issued, self._ever_limited)
            self._stands_until = min(now + _STANDS_S, self._check_again)
        return self._standing

    def ever_issued(self) -> bool:
        """Tell whether any token was ever issued; from then on, nobody writes without one.

        Revoked tokens count, so revoking the last one does not open the store to everybody. Every
        request asks, so the file is checked at most ten times a second; a first token created by
        another process is noticed within that time.
        """
        self._look()
        return self._ever_issued

    def ever_limited(self) -> bool:
        """Tell whether any token was ever limited to some graphs.

        From then on nobody reads without a token: the holder of such a token could otherwise read
        everything by leaving it out. It is noticed as fast as a first token.
        """
        self._look()
        return self._ever_limited

    def _look(self) -> None:
        now = time.monotonic()
        # Neither answer ever turns back, so both are asked only until they are yes.
        if self._ever_limited or now < self._look_again:
            return
        self._look_again = now + _LOOK_EVERY_S
        with self._reading() as connection:
            any_token, limited = connection.execute(_LOOK).fetchone()
        self._ever_issued |= bool(any_token)
        self._ever_limited |= bool(limited)

    def has_schema(self, agent: str) -> bool:
        """Return whether a token of an agent that is in force may state axioms about any term."""
        return any(
            token.agent == agent
            and not token.revoked
            and (token.role == "admin" or "schema" in token.rights)
            for token in self.all()
        )

    def all(self) -> list[Token]:
        """Return all tokens, oldest first."""
        with self._reading() as connection:
            rows = connection.execute("SELECT * FROM tokens ORDER BY created").fetchall()
        return [_token(row) for row in rows]

    def rows(self) -> list[list[str | None]]:
        """Return all tokens with the digests of their secrets, for a follower's store."""
        with self._reading() as connection:
            rows = connection.execute("SELECT * FROM tokens ORDER BY id").fetchall()
        return [[v.hex() if isinstance(v, bytes) else v for v in row] for row in rows]

    def replace(self, rows: Iterable[Sequence[str | None]]) -> None:
        """Take over the tokens of another store, as :meth:`rows` gives them."""
        values = [(row[0], bytes.fromhex(row[1] or ""), *row[2:]) for row in rows]
        # In one transaction: between the two nobody would be let in.
        with self._lock, self._connection() as connection:
            connection.execute("DELETE FROM tokens")
            connection.executemany("INSERT INTO tokens VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)

    def revoke(self, token_id: str) -> bool:
        """Revoke a token; tell whether there was one to revoke."""
        now = datetime.now(UTC).isoformat()
        with self._lock, self._connection() as connection:
            done = connection.execute(
                "UPDATE tokens SET revoked = ? WHERE id = ? AND revoked IS NULL", (now, token_id)
            )
        return done.rowcount > 0

    def expire(self, token_id: str, lifetime: timedelta) -> bool:
        """Let a token expire after a time from now; return whether there was one not revoked."""
        return self.expire_at(token_id, datetime.now(UTC) + lifetime)

    def expire_at(self, token_id: str, time: datetime | None) -> bool:
        """Let a token expire at a time, or never; return whether there was one not revoked."""
        until = None if time is None else time.isoformat()
        with self._lock, self._connection() as connection:
            done = connection.execute(
                "UPDATE tokens SET expires = ? WHERE id = ? AND revoked IS NULL", (until, token_id)
            )
        return done.rowcount > 0

    def close(self) -> None:
        """Close all connections; the store cannot be used afterwards."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1
        while self._open:
            self._open.pop().close()

    def _row(self, token_id: str) -> Row | None:
        with self._reading() as connection:
            row = connection.execute("SELECT * FROM tokens WHERE id = ?", (token_id,)).fetchone()
        return cast("Row | None", row)

    @contextlib.contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Yield this thread's connection, kept open so that a look-up takes microseconds."""
        if self._memory is not None:
            with self._lock:
                yield self._memory
            return
        connection = getattr(self._local, "connection", None)
        if connection is None:
            # Closed by another thread than its own, when the server ends.
            connection = sqlite3.connect(str(self._path), check_same_thread=False)
            self._local.connection = connection
            self._open.append(connection)
        yield connection

    @contextlib.contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection for one transaction."""
        if self._memory is not None:
            with self._memory:
                yield self._memory
            self._memory_version += 1
            return
        connection = sqlite3.connect(str(self._path))
        try:
            with connection:
                yield connection
        finally:
            connection.close()
            self._check_again = self._stands_until = -math.inf


def _digest(secret: str) -> bytes:
    return hashlib.sha256(secret.encode()).digest()


def _token(row: Row) -> Token:
    token_id, _, agent, role, created, expires, revoked, rights = row
    granted = tuple(rights.split()) if rights else ()
    return Token(token_id, agent, role, created, expires, revoked, granted)


def _joined(rights: tuple[str, ...]) -> str | None:
    return " ".join(rights) or None


def require_rights(token: Token) -> None:
    """Refuse rights that do not exist, and those that a reader cannot have.

    Raises
    ------
    UsageError
        Naming the right.
    """
    if token.role == "reader" and "rules" in token.rights:
        raise UsageError("a reader writes nothing; give the right to another role")
    _ = token.access
