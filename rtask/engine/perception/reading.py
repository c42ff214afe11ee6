"""Words on views that were stored before words were read."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np

from rtask.engine.networks.printed_words import PrintedWords, UnreadView, unread_views
from rtask.engine.perception.images import decode_picture
from rtask.engine.perception.observation import stored_frame
from rtask.engine.triples import Triples
from rtask.errors import MissingBlobError, UsageError

if TYPE_CHECKING:
    from features.words.word import Word
    from rtask.engine.context import Context
    from rtask.engine.view_index import Progress

__all__ = ["read_stored_views"]

log = logging.getLogger(__name__)

_VIEWS_OF_COMMIT = 50


def read_stored_views(context: Context, progress: Progress | None = None) -> tuple[int, int, int]:
    """Read the words on all stored views without a reading, and state them beside the views.

    Views are committed by the fifty, so that little is lost if the process ends; the next call goes
    on from there.

    Returns
    -------
    int, int, int
        Views read, words on them, and views whose picture cannot be read.

    Raises
    ------
    UsageError
        The context has no reader.
    """
    words = context.words
    if words is None:
        raise UsageError("words are not read: give the engine a reader, or set RTASK_WORDS=1")
    unread = unread_views(context.kb)
    read, count, failed = 0, 0, 0
    for start in range(0, len(unread), _VIEWS_OF_COMMIT):
        readings: list[tuple[UnreadView, tuple[Word, ...]]] = []
        for number, row in enumerate(unread[start : start + _VIEWS_OF_COMMIT], start + 1):
            on_view = _words_of(context, words, row)
            if on_view is None:
                failed += 1
            else:
                readings.append((row, on_view))
                count += len(on_view)
            if progress is not None:
                progress(number, len(unread))
        _state(context, words, readings)
        read += len(readings)
    return read, count, failed


def _words_of(context: Context, words: PrintedWords, row: UnreadView) -> tuple[Word, ...] | None:
    """Return the words of a stored view, or None if its picture cannot be read."""
    try:
        rgb = decode_picture(context.kb.blobs.read(row.picture), "picture")
    except (MissingBlobError, UsageError) as error:
        log.warning("view %s was not read: %s", row.view.value, error)
        return None
    stored = stored_frame(context.kb, row.view.value)
    mask = np.ones(rgb.shape[:2], bool)
    # A picture that came beside the cloud may have pixels of its own.
    if stored is not None and stored[1] and stored[0].depth_m.shape == mask.shape:
        mask = stored[0].object_mask()
    return words.read_picture(rgb, mask)


def _state(
    context: Context, words: PrintedWords, readings: list[tuple[UnreadView, tuple[Word, ...]]]
) -> None:
    """State readings in the graphs of their views, so that both go together."""
    if not readings:
        return
    rights = context.kb.access()
    with context.writing, context.kb.transaction(note="read words") as tx:
        for row, on_view in readings:
            triples = Triples()
            words.state(triples, row.view, on_view)
            graph = row.graph if rights.may_write(row.graph) else None
            for subject, predicate, value in triples:
                tx.add(subject, predicate, value, graph)
