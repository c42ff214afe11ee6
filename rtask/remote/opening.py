"""Open a knowledge base whose statements are on a SPARQL 1.1 server.

The settings are on the server, so that every process uses the same base. A folder on this machine,
one for each address, holds the byte strings that the graph names (images, clouds, meshes), tokens
and the audit trail. The search index is in memory.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import secrets
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rtask.errors import NoStoreError, StoreError, StoreFormatError, UnsupportedError
from rtask.kb.durability.blobs import BlobStore
from rtask.kb.durability.folder import Files
from rtask.kb.durability.settings import Settings
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import Literal
from rtask.remote.dialect import Abilities, Dialect
from rtask.remote.endpoints import Endpoints
from rtask.remote.head import Head, HeadGraph, remove_left_behind
from rtask.remote.journal import RemoteJournal
from rtask.remote.probe import probe
from rtask.remote.store import RemoteStore
from rtask.remote.transport import without_password

__all__ = ["Place", "default_folder", "open_on_server"]

_log = logging.getLogger(__name__)
_SETTINGS = "<urn:rtask:store:settings>"


@dataclass(frozen=True)
class Place:
    """A server and the folder that belongs to it.

    Parameters
    ----------
    address
        As for :func:`rtask.open`.
    folder
        On this machine; ``None`` for the one of the address, below ``$XDG_DATA_HOME/rtask``.
    """

    address: str
    folder: Path | None = None


def default_folder(address: str) -> Path:
    """Return the folder of an address for this user."""
    home = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    key = hashlib.sha256(without_password(address).encode()).hexdigest()[:16]
    return Path(home) / "rtask" / "stores" / key


def open_on_server(
    endpoints: Endpoints, place: Place, mode: str, base: str | None, union: str | None
) -> Files:
    """Open the knowledge base on a server; create it there if there is none.

    Raises
    ------
    StoreFormatError
        There is none and ``mode`` is ``"r"``, or another one than was asked for.
    RemoteError, AccessError
        The server does not answer, or refuses.
    """
    if union == "view":
        raise UnsupportedError("union='view' needs the embedded store; omit it")
    try:
        return _open(endpoints, place, mode, base)
    except BaseException:
        endpoints.connection.close()
        raise


def _open(endpoints: Endpoints, place: Place, mode: str, base: str | None) -> Files:
    remote_base = _find(endpoints, base)
    if remote_base is None:
        if mode == "r":
            raise NoStoreError(f"{endpoints} holds no knowledge base; open it for writing once")
        remote_base = _create(endpoints, base)
    elif mode == "new":
        raise StoreFormatError(f"{endpoints} is already a knowledge base; open it with mode='rw'")
    elif mode == "rw":
        _require_same_default_graph(endpoints, remote_base)
    folder = place.folder or default_folder(endpoints.address)
    address = without_password(endpoints.address)
    settings = replace(remote_base.settings, store=address)
    settings.require(folder, base, plain=False)
    _note(folder, settings)
    dialect = Dialect(settings.base, remote_base.abilities)
    graphs = Graphs(settings.base)
    head = HeadGraph(endpoints, dialect).read()
    if mode != "r":
        remove_left_behind(endpoints, _name(settings.base))
    store = RemoteStore(endpoints, dialect, graphs, head)
    blobs = BlobStore(folder / "blobs", writable=mode != "r")
    journal = RemoteJournal(store, graphs)
    return Files(settings, store, blobs, journal, folder, last_seq=head.seq)


@dataclass(frozen=True)
class _RemoteBase:
    """Settings and abilities that the server keeps beside a knowledge base's graphs."""

    settings: Settings
    abilities: Abilities

    def text(self) -> str:
        abilities = {**asdict(self.abilities), "encoded": sorted(self.abilities.encoded)}
        return json.dumps({"settings": asdict(self.settings), "abilities": abilities})

    @classmethod
    def of(cls, text: str) -> _RemoteBase:
        record: dict[str, Any] = json.loads(text)
        abilities = record["abilities"]
        abilities["encoded"] = frozenset(abilities["encoded"])
        return cls(Settings(**record["settings"]), Abilities(**abilities))


def _name(base: str) -> str:
    return f"<{base}graph/store>"


def _find(endpoints: Endpoints, base: str | None) -> _RemoteBase | None:
    rows = endpoints.rows(f"SELECT ?v {{ GRAPH ?g {{ ?g {_SETTINGS} ?v }} }}")
    candidates = [_RemoteBase.of(text.value) for (text,) in rows]
    if base is not None:
        return next(
            (candidate for candidate in candidates if candidate.settings.base == base), None
        ) or (candidates[0] if candidates else None)
    if len(candidates) > 1:
        bases = ", ".join(sorted(candidate.settings.base for candidate in candidates))
        raise StoreFormatError(f"{endpoints} holds several knowledge bases; name one base: {bases}")
    return candidates[0] if candidates else None


def _create(endpoints: Endpoints, base: str | None) -> _RemoteBase:
    remote_base = _RemoteBase(Settings.new(base), probe(endpoints))
    name = _name(remote_base.settings.base)
    head = Head(0, secrets.token_hex(6))
    endpoints.update(
        f"INSERT DATA {{ GRAPH {name} {{ {name} {_SETTINGS} {Literal(remote_base.text())} . "
        f"{name} <urn:rtask:store:head> {head} }} }}"
    )
    existing = _find(endpoints, base)
    if existing is None:
        raise StoreError(
            f"{endpoints} took the settings of a knowledge base and does not show them"
        )
    return existing


def _require_same_default_graph(endpoints: Endpoints, remote_base: _RemoteBase) -> None:
    """Refuse a server whose default graph has begun or ceased to show the named graphs."""
    name = _name(remote_base.settings.base)
    shows = endpoints.ask(f"ASK {{ {name} {_SETTINGS} ?v }}")
    if shows and remote_base.abilities.default_graph:
        raise StoreFormatError(
            f"{endpoints}: the default graph shows the named graphs, and did not when the "
            "knowledge base was made; start the server with its former settings"
        )


def _note(folder: Path, settings: Settings) -> None:
    """Write the settings into the folder, so that it can be opened in the place of the address."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "kb.json").exists():
        settings.save(folder)
        return
    there = Settings.load(folder)
    if there.store_id != settings.store_id or there.store is None:
        holds = f"belongs to {there.store}" if there.store else "keeps its statements itself"
        raise StoreFormatError(
            f"{folder} {holds}; what goes with {settings.store} needs a folder of its own: name a "
            "new one, whose tokens `rtask token create --store URL --data FOLDER` makes"
        )
    if there != settings:
        settings.save(folder)
