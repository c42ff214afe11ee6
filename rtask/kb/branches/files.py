"""Files of a branch: the trunk's store by hard links, and a journal of its own.

::

    DIR/branches/NAME/branch.json      record of the branch
                      store/           the quads: the trunk's files, and what was written since
                      journal/         the commits of the branch, numbered from its base
                      checkpoint.json  the base; the journal is replayed at each opening
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from pyoxigraph import Store

from rtask.errors import StoreError, UnsupportedError
from rtask.kb.branches.record import BranchRecord
from rtask.kb.durability.blobs import sync_folder
from rtask.kb.durability.disk_space import full_disk, means_full
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import Checkpoint, boot_id, recover
from rtask.kb.feed.as_of import turn_back
from rtask.kb.store.embedded import EmbeddedStore, embedded_store
from rtask.kb.store.graphs import Graphs

__all__ = ["home_of", "make_branch", "open_branch", "remove_branch"]

_DRAFT = ".draft"


def home_of(files: Files) -> Path:
    """Return the folder of the branches of a graph.

    Raises
    ------
    UnsupportedError
        The graph is in memory, on a server, open for reading, or a branch itself.
    """
    if files.is_branch:
        raise UnsupportedError("this is a branch; branch off the trunk")
    if files.folder is None or not isinstance(files.journal, JournalFile):
        raise UnsupportedError("a branch needs a graph in a folder; this one is not in any")
    if files.checkpoints is None:
        raise UnsupportedError("a branch needs the folder to be open for writing")
    embedded_store(files.store, "a branch")
    return files.folder / "branches"


def make_branch(files: Files, graphs: Graphs, record: BranchRecord, is_head: bool) -> None:
    """Make the folder of a branch, while nobody writes if it begins at the last commit.

    Raises
    ------
    StorageFullError, StoreError
        There is no room, or the folder cannot be written.
    UnsupportedError
        A bulk load was made since the commit on which it rests.
    """
    home = home_of(files)
    draft = home / (record.name + _DRAFT)
    assert isinstance(files.journal, JournalFile)
    try:
        home.mkdir(exist_ok=True)
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir()
        path = str(draft / "store")
        if is_head:
            with files.store.complete():
                embedded_store(files.store, "a branch").raw.backup(path)
        else:
            turn_back(files, graphs, files.journal, path, record.base).close()
        (draft / "journal").mkdir()
        Checkpoint(record.base, clean=False, boot=boot_id()).save(draft)
        record.save(draft)
        draft.rename(home / record.name)
        sync_folder(home)
    except (OSError, RuntimeError) as error:
        shutil.rmtree(draft, ignore_errors=True)
        if means_full(error):
            raise full_disk(home, "for a branch") from error
        raise StoreError(f"the branch cannot be made in {home}: {error}") from error
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


def open_branch(files: Files, record: BranchRecord) -> Files:
    """Open the files of a branch; the blobs are the trunk's.

    Raises
    ------
    StoreError
        They cannot be opened.
    """
    folder = home_of(files) / record.name
    path = str(folder / "store")
    settings = replace(files.settings, epoch=record.epoch)
    try:
        store = EmbeddedStore(Store(path), path)
    except (OSError, RuntimeError) as error:
        raise StoreError(f"the branch in {folder} cannot be opened: {error}") from error
    journal = JournalFile(folder / "journal")
    try:
        store.is_view = settings.is_view
        recovered = recover(folder, store, journal, settings)
    except BaseException:
        journal.close()
        store.close()
        raise
    return Files(
        settings,
        store,
        files.blobs,
        journal,
        folder,
        last_seq=max(recovered.last_seq, record.base),
        is_branch=True,
    )


def remove_branch(files: Files, name: str) -> None:
    """Delete the folder of a branch, which is closed."""
    folder = home_of(files) / name
    gone = folder.with_name(name + _DRAFT)
    shutil.rmtree(gone, ignore_errors=True)
    if folder.exists():
        folder.rename(gone)  # at once, so that a crash leaves no half of it
        shutil.rmtree(gone, ignore_errors=True)
