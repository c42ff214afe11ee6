"""Killed at any point, the index opens again with every acknowledged view."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from features.recognition import IndexCorruptError, RecognitionIndex, ViewFeatures
from features.recognition.index.journal import Change, Journal, read_changes

WRITER = """
import sys
from pathlib import Path
from features.recognition import RecognitionIndex, ViewFeatures
features = ViewFeatures.from_bytes(Path(sys.argv[2]).read_bytes())
index = RecognitionIndex(sys.argv[1], seal_rows=int(sys.argv[3]))
number = len(index)
while True:
    index.add(f"view:{number}", f"object:{number}", "class:card", features)
    print(number, flush=True)
    if number % 5 == 4:
        index.remove(f"view:{number - 2}")
        print(-(number - 2), flush=True)
    number += 1
"""


@pytest.fixture
def small_view(card_views) -> ViewFeatures:
    """Return a view with few keypoints: what counts here is the number of changes."""
    from dataclasses import replace

    view = card_views(0, 1)[0]
    return replace(
        view,
        keypoints=view.keypoints[:40],
        descriptors=view.descriptors[:40],
        points3d=view.points3d[:40],
    )


@pytest.mark.slow
@pytest.mark.parametrize("seal_rows", [10**9, 200])
def test_kill_9_loses_nothing_that_was_acknowledged(tmp_path: Path, small_view, seal_rows) -> None:
    (tmp_path / "view.npz").write_bytes(small_view.to_bytes())
    present: set[int] = set()
    for last in (12, 43):
        command = [sys.executable, "-c", WRITER, tmp_path / "index", tmp_path / "view.npz"]
        with subprocess.Popen([*command, str(seal_rows)], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            for line in writer.stdout:
                number = int(line)
                present.add(number) if number >= 0 else present.discard(-number)
                if number >= last:
                    writer.send_signal(signal.SIGKILL)
                    break
            for line in writer.stdout:
                number = int(line)
                present.add(number) if number >= 0 else present.discard(-number)
        with RecognitionIndex(tmp_path / "index", seal_rows=seal_rows) as index:
            stored = {int(name.view_iri.split(":")[1]) for name in index.views()}
            # Killed between writing and saying so, one change more may be there.
            assert len(present ^ stored) <= 1
            present = stored
            kept = {path.name for path in (tmp_path / "index").glob("seg-*")}
            assert len(kept) == len([p for p in index.snapshot().parts if p.block.tables])


def test_a_journal_cut_anywhere_keeps_its_whole_records(tmp_path: Path) -> None:
    path = tmp_path / "delta.log"
    changes = [Change("add", f"view:{k}", "o", "c", bytes([k]) * (20 + k)) for k in range(4)]
    ends = []
    with Journal(path) as journal:
        for change in changes:
            journal.append(change)
            ends.append(path.stat().st_size)
    data = path.read_bytes()
    for cut in range(len(data) + 1):
        path.write_bytes(data[:cut])
        whole = sum(end <= cut for end in ends)
        read, length = read_changes(path)
        assert read == changes[:whole]
        assert length == ([0, *ends])[whole]


def test_writing_goes_on_behind_a_torn_record(tmp_path: Path) -> None:
    path = tmp_path / "delta.log"
    with Journal(path) as journal:
        journal.append(Change("remove", "view:1"))
    path.write_bytes(path.read_bytes() + b"\x40\x00\x00\x00torn")
    _, length = read_changes(path)
    with Journal(path, length) as journal:
        journal.append(Change("remove", "view:2"))
    assert [change.view_iri for change in read_changes(path)[0]] == ["view:1", "view:2"]


def test_damage_before_the_end_of_a_journal_is_no_torn_record(tmp_path: Path) -> None:
    path = tmp_path / "delta.log"
    with Journal(path) as journal:
        for k in range(3):
            journal.append(Change("remove", f"view:{k}"))
    data = bytearray(path.read_bytes())
    data[12] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(IndexCorruptError, match="byte 0"):
        read_changes(path)


def test_what_the_manifest_does_not_name_is_deleted(tmp_path: Path, small_view) -> None:
    folder = tmp_path / "index"
    with RecognitionIndex(folder) as index:
        index.add("view:a", "object:a", "class:card", small_view)
        index.save()
    segment = min(folder.glob("seg-*"))
    shutil.copytree(segment, folder / "seg-000099")
    (folder / "seg-000100").mkdir()
    (folder / "delta-000098.log").write_bytes(b"half")
    (folder / "manifest.json.tmp").write_text("{")
    with RecognitionIndex(folder) as index:
        assert len(index) == 1
    assert [path.name for path in folder.glob("seg-*")] == [segment.name]
    assert len(list(folder.glob("delta-*.log"))) == 1
    assert not (folder / "manifest.json.tmp").exists()


STEPS = """
import os, sys
from pathlib import Path
from features.recognition import RecognitionIndex, ViewFeatures
import features.recognition.index.folder as folder
import features.recognition.index.segments as segments

left = 0
def dying(function):
    def step(*args, **kwargs):
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), 9)
        return function(*args, **kwargs)
    return step

def seal(path):
    index = RecognitionIndex(path)
    index.add("view:new", "object:new", "class:card", features)
    for module in (folder, segments):
        module.write_durably = dying(module.write_durably)
        module.sync_folder = dying(module.sync_folder)
    folder.IndexFolder.commit = dying(folder.IndexFolder.commit)
    folder.IndexFolder.sweep = dying(folder.IndexFolder.sweep)
    index.save()

features = ViewFeatures.from_bytes(Path(sys.argv[1]).read_bytes())
# Each dies in a process of its own; one import serves them all.
for path in sys.argv[2:]:
    child = os.fork()
    if child == 0:
        left, status = int(path.rpartition("-")[2]), 1
        try:
            seal(path)
            status = 0
        finally:
            os._exit(status)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.mark.slow
def test_killed_at_any_step_of_a_seal_nothing_is_lost(tmp_path: Path, small_view) -> None:
    (tmp_path / "view.npz").write_bytes(small_view.to_bytes())
    with RecognitionIndex(tmp_path / "start") as index:
        for k in range(3):
            index.add(f"view:{k}", f"object:{k}", "class:card", small_view)
        index.save()
        index.remove("view:1")
    # Twelve files of a segment, its folder, commit, manifest, folder, sweep: then it succeeds.
    folders = [tmp_path / f"index-{left}" for left in (0, 1, 6, 11, 12, 13, 14, 15, 16, 40)]
    for folder in folders:
        shutil.copytree(tmp_path / "start", folder)
    command = [sys.executable, "-c", STEPS, tmp_path / "view.npz", *folders]
    done = subprocess.run(command, capture_output=True, check=True)
    assert [int(code) for code in done.stdout.split()] == [-signal.SIGKILL] * 9 + [0], done.stderr
    for folder in folders:
        with RecognitionIndex(folder) as index:
            stored = {name.view_iri for name in index.views()}
        assert stored == {"view:0", "view:2", "view:new"}, folder.name
