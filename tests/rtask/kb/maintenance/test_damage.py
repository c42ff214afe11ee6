"""Files of a knowledge base that somebody deleted, cut or changed are noticed at opening."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pyoxigraph as ox
import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli
from rtask.errors import StoreError, StoreFormatError, StoreLockedError
from rtask.kb.maintenance.rebuild import rebuild_journal, rebuild_store
from rtask.knowledge_base import KnowledgeBase

COMMITS = 40


def _open(path: Path, **options: object) -> KnowledgeBase:
    graph = rtask.open(path, ontologies=False, **options)  # type: ignore[arg-type]
    assert isinstance(graph, KnowledgeBase)
    return graph


@pytest.fixture(scope="module", params=[False, True], ids=["graph", "plain"])
def closed(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """A folder that was closed in order."""
    folder = tmp_path_factory.mktemp("closed") / "kb"
    with _open(folder, plain=request.param) as kb:
        for number in range(COMMITS):
            kb.update(f"INSERT DATA {{ <urn:s{number}> <urn:p> {number}, 'text {number}' }}")
        kb.update("DELETE WHERE { <urn:s0> ?p ?o }")
    return folder


@pytest.fixture
def folder(closed: Path, tmp_path: Path) -> Path:
    shutil.copytree(closed, tmp_path / "kb")
    return tmp_path / "kb"


def _quads(folder: Path) -> list[str]:
    with _open(folder) as kb:
        return sorted(map(str, kb.store.quads_for_pattern(None, None, None)))


def _delete(path: Path) -> None:
    path.unlink()


def _cut(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])


def _flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    # a digit of the middle: text stays text, so that only a checksum can notice
    at = next(i for i in range(len(data) // 2, len(data)) if chr(data[i]).isdigit())
    data[at] ^= 1
    path.write_bytes(bytes(data))


DAMAGES = pytest.mark.parametrize("damage", [_delete, _cut, _flip])


@pytest.mark.slow
@DAMAGES
def test_a_damaged_journal_is_refused_and_can_be_given_up(
    folder: Path, damage: Callable[[Path], None]
) -> None:
    before = _quads(folder)
    [segment] = (folder / "journal").glob("*.log")
    damage(segment)
    for mode in ("rw", "r"):
        with pytest.raises(
            StoreFormatError, match=f"{segment.name} (is missing|has|does not match)"
        ):
            _open(folder, mode=mode)
    done = CliRunner().invoke(cli, ["rebuild", "journal", "-d", str(folder)])
    assert (done.exit_code, done.output) == (0, f"journal: up to commit {COMMITS + 1}\n")
    assert _quads(folder) == before
    with _open(folder) as kb:
        assert kb.update("INSERT DATA { <urn:after> <urn:p> 1 }").seq == COMMITS + 2
        assert kb.verify() == []
    assert list(folder.glob("journal.*")), "the damaged journal must be kept"


def test_a_lost_checkpoint_is_made_again_from_the_journal(folder: Path) -> None:
    before = _quads(folder)
    (folder / "checkpoint.json").unlink()
    assert _quads(folder) == before
    with _open(folder) as kb:
        assert kb.update("INSERT DATA { <urn:after> <urn:p> 1 }").seq == COMMITS + 2
        assert kb.verify() == []


@pytest.mark.slow
@pytest.mark.parametrize("damage", [_cut, _flip])
def test_a_damaged_checkpoint_is_made_again_from_the_journal_with_a_warning(
    folder: Path, damage: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    before = _quads(folder)
    damage(folder / "checkpoint.json")
    with pytest.raises(StoreFormatError, match=r"damaged.*for writing"):
        rtask.open(folder, mode="r")
    with _open(folder) as kb:
        assert kb.verify() == []
    assert "checkpoint.json is damaged" in caplog.text
    assert _quads(folder) == before


def test_a_store_without_checkpoint_and_journal_is_refused(folder: Path) -> None:
    (folder / "checkpoint.json").unlink()
    shutil.rmtree(folder / "journal")
    with pytest.raises(StoreFormatError, match="lost both"):
        _open(folder)


@pytest.mark.slow
@DAMAGES
def test_a_damaged_store_is_named_and_made_again_from_the_journal(
    folder: Path, damage: Callable[[Path], None]
) -> None:
    before = _quads(folder)
    rng = random.Random(4)
    tables = sorted((folder / "store").glob("*.sst"))
    victim = rng.choice(tables)
    if damage is _flip:
        data = bytearray(victim.read_bytes())
        data[len(data) // 2] ^= 1
        victim.write_bytes(bytes(data))
    else:
        damage(victim)
    if damage is not _flip:  # RocksDB checks a block when it reads it, which may be never
        with pytest.raises(StoreFormatError, match="rtask rebuild store"):
            _open(folder)
    assert rebuild_store(folder) == COMMITS + 1
    assert _quads(folder) == before
    with _open(folder) as kb:
        assert kb.verify() == []
        assert kb.update("INSERT DATA { <urn:after> <urn:p> 1 }").seq == COMMITS + 2


@pytest.mark.slow
def test_a_flipped_bit_in_the_store_is_never_a_bare_error_of_the_store(
    closed: Path, tmp_path: Path
) -> None:
    noticed = 0
    for table in sorted((closed / "store").glob("*.sst")):
        folder = tmp_path / table.stem
        shutil.copytree(closed, folder)
        data = bytearray(table.read_bytes())
        data[len(data) // 2] ^= 1
        (folder / "store" / table.name).write_bytes(bytes(data))
        try:
            with _open(folder) as kb:
                for number in range(COMMITS):
                    kb.match(f"urn:s{number}")
                    list(kb.store.quads_for_pattern(None, None, ox.Literal(f"text {number}")))
        except StoreFormatError:
            noticed += 1
    assert noticed


def test_an_incomplete_journal_makes_no_store(folder: Path) -> None:
    with _open(folder) as kb:
        kb.update("INSERT DATA { <urn:more> <urn:p> 1 }")
    rebuild_journal(folder)
    with pytest.raises(StoreFormatError, match=r"from commit 0 to 42"):
        rebuild_store(folder)
    with _open(folder) as kb:
        assert len(kb.match("urn:s1")) == 2


def test_an_open_folder_is_not_rebuilt(folder: Path) -> None:
    with _open(folder):
        for rebuild in (rebuild_store, rebuild_journal):
            with pytest.raises(StoreLockedError):
                rebuild(folder)


def test_a_folder_that_was_not_closed_is_recovered_before_its_journal_is_given_up(
    folder: Path,
) -> None:
    from rtask.kb.durability.recovery import Checkpoint

    Checkpoint(3, clean=False).save(folder)
    with pytest.raises(StoreError, match="open it once"):
        rebuild_journal(folder)
