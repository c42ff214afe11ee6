"""Episodes of a recording, or of a data set with one, read into a graph (extra ``recordings``)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pyoxigraph import NamedNode, Quad, RdfFormat, parse

from rtask.errors import DataError, ForbiddenError, UsageError
from rtask.interop.episodes.demonstrations import is_dataset, read_demonstrations
from rtask.interop.episodes.episode import blobs_of
from rtask.interop.episodes.plausible import check_episodes
from rtask.interop.episodes.recording import BLOBS_TOPIC, RECORDING, STATEMENTS_TOPIC, Written

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore

__all__ = ["read_episodes"]


def read_episodes(kb: GraphCore, path: Path, access: Access | None = None) -> Written:
    """Add the episodes of a file to a graph, in one commit; known statements change nothing.

    What a robot asserted goes to the graph of the robot of that name. Damaged files leave the graph
    as it was, and so do files in which one robot says what another, or a person, did.

    Parameters
    ----------
    kb
        The graph, open for writing.
    path
        From :func:`~rtask.interop.episodes.recording.write_episodes`, or a data set of
        :mod:`~rtask.interop.episodes.lerobot`, or one of others, of which there is less to read
        (:mod:`~rtask.interop.episodes.demonstrations`).
    access
        Rights of who imports; a robot's file may hold its own episodes alone. None = the owner.

    Raises
    ------
    DataError
        It is no such file, binary data is missing or does not match its name, or it says what
        cannot be so (:mod:`~rtask.interop.episodes.plausible`).
    ConflictError
        It says otherwise than what is stored of an attempt.
    ForbiddenError
        It speaks in the name of another than whose graph it is in, or than the importing robot.
    """
    if path.is_dir():
        if is_dataset(path) and not (path / RECORDING).is_file():
            return read_demonstrations(kb, path, access)
        path = path / RECORDING
        if not path.is_file():
            raise UsageError(
                f"{path.parent.parent} is no data set: neither {RECORDING} nor meta/info.json"
            )
    quads: dict[Quad, None] = {}
    blobs: dict[str, bytes] = {}
    read = Written()
    for topic, message in _messages(path):
        if topic == STATEMENTS_TOPIC:
            try:
                quads |= dict.fromkeys(parse(message.data.encode(), format=RdfFormat.N_QUADS))
            except SyntaxError as error:
                raise DataError(f"{path}: {STATEMENTS_TOPIC}: {error}") from error
            read.episodes += 1
        elif topic == BLOBS_TOPIC:
            name, data = message.layout.dim[0].label, bytes(message.data)
            if name != f"urn:sha256:{hashlib.sha256(data).hexdigest()}":
                raise DataError(f"{path}: the bytes of {name} do not match their name")
            blobs[name] = data
    if not read.episodes:
        raise DataError(f"{path} holds no episodes: no topic {STATEMENTS_TOPIC}")
    missing = [name for name in blobs_of(quads) if name not in blobs and not kb.blobs.has(name)]
    if missing:
        raise DataError(f"{path}: {len(missing)} binary data are missing, {missing[0]} first")
    owned = list(_owned_here(kb, quads))
    _check_names(kb, quads, owned, access)
    check_episodes(kb, owned)
    for data in blobs.values():
        kb.blobs.put(data)
    with kb.transaction(note=f"episodes of {path.name}", access=access) as transaction:
        transaction.add_quads(owned)
    read.statements, read.blobs = len(quads), len(blobs)
    return read


def _messages(path: Path) -> Iterator[tuple[str, Any]]:
    from rosbags.highlevel import AnyReader, AnyReaderError

    if not path.is_file():
        raise UsageError(f"{path}: there is no such file")
    try:
        with AnyReader([path]) as reader:
            connections = [
                link for link in reader.connections if link.topic in (STATEMENTS_TOPIC, BLOBS_TOPIC)
            ]
            for connection, _, raw in (
                reader.messages(connections=connections) if connections else ()
            ):
                yield connection.topic, reader.deserialize(raw, connection.msgtype)
    except (AnyReaderError, OSError, AssertionError) as error:
        raise DataError(f"{path} is no recording, or it is damaged: {error}") from error


def _owned_here(kb: GraphCore, quads: Iterable[Quad]) -> Iterator[Quad]:
    """Yield statements in the graphs that the same robots, people and files have here."""
    for quad in quads:
        named = quad.graph_name.value if isinstance(quad.graph_name, NamedNode) else ""
        _, _, place = named.partition("/graph/")
        if not place.startswith(("agent/", "import/")):
            raise DataError(f"{named or 'the default graph'} is not that of a robot or a file")
        graph = NamedNode(f"{kb.graphs.base}graph/{place}")
        yield Quad(quad.subject, quad.predicate, quad.object, graph)


def _check_names(
    kb: GraphCore, quads: Iterable[Quad], owned: Iterable[Quad], access: Access | None
) -> None:
    """Refuse statements of one robot, or of a file, about what another robot or a person did.

    Parameters
    ----------
    quads, owned
        The statements in the graphs of the file, and in those that they go to.

    Raises
    ------
    ForbiddenError
        Naming the graph or the statement.
    """
    from rtask.kb.commit.access import Access, actor_of
    from rtask.kb.store.graphs import Graphs

    @cache
    def speaks_here(name: str) -> bool:
        return bool(kb.match(graph=kb.graphs.agent(name)))

    rights = None if access is None else access.bind(kb.graphs)
    for quad, here in zip(quads, owned, strict=True):
        if rights is not None:
            rights.require_write(here.graph_name, "import of episodes")
        owner = kb.graphs.owner(here.graph_name)
        base = str(quad.graph_name).strip("<>").partition("graph/")[0]
        for names in {kb.graphs.base: kb.graphs, base: Graphs(base)}.values():
            if owner is not None:
                Access(owner, "robot").require_own_identity(here, names)
                continue
            acting = actor_of(here, names)
            if acting is not None and speaks_here(acting[1]) and not kb.match(*here):
                raise ForbiddenError(
                    f"{here.graph_name}: an unsigned graph cannot state {here.predicate} "
                    f"{here.object}: {acting[1]!r} speaks for itself",
                    statement=f"{here.subject} {here.predicate} {here.object}",
                )
