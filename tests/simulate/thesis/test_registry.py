"""The list of tables and figures, against the theses' texts and against this project."""

from __future__ import annotations

import importlib
import os
import re
from pathlib import Path

import pytest

from rtask.errors import UsageError
from simulate.thesis.entry import Entry
from simulate.thesis.registry import ENTRIES, entries_named

_ROOT = Path(__file__).resolve().parents[3]
_TEXTS = Path(os.environ.get("RTASK_SHARED_DATA", _ROOT / "shared" / "data")).parent / "seeds"
_CAPTION = re.compile(r"^\W*(Figure|Table|Algorithm) (\d+(?:\.\d+)?):", re.MULTILINE)


@pytest.mark.parametrize(
    ("thesis", "file", "least"), [("gatto", "000_*", 35), ("kehoe", "002_*", 58)]
)
def test_every_captioned_number_of_the_text_has_an_entry(
    thesis: str, file: str, least: int
) -> None:
    texts = list(_TEXTS.glob(f"{file}.txt")) if _TEXTS.is_dir() else []
    if not texts:
        pytest.skip("the theses' texts are not here")
    captions = {
        f"{thesis}-{kind.lower().replace('figure', 'fig')}-{number}"
        for kind, number in _CAPTION.findall(texts[0].read_text(encoding="utf-8"))
    }
    assert len(captions) >= least
    assert captions <= {entry.name for entry in ENTRIES}


def test_names_are_unique() -> None:
    names = [entry.name for entry in ENTRIES]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("run", sorted({entry.run for entry in ENTRIES if entry.run}))
def test_every_run_exists(run: str) -> None:
    module, _, function = run.partition(":")
    assert callable(getattr(importlib.import_module(f"simulate.thesis.runs.{module}"), function))


@pytest.mark.parametrize("entry", [e for e in ENTRIES if e.why], ids=lambda e: e.name)
def test_what_a_reason_names_exists(entry: Entry) -> None:
    for path in re.findall(r"(?:docs|tests)/[\w./-]*\w", entry.why):
        assert (_ROOT / path).exists(), path
    for name in re.findall(r"(?:gatto|kehoe)-[a-z]+-[\w.]+", entry.why):
        assert entries_named(name.rstrip("."))


def test_a_number_means_all_that_carry_it() -> None:
    assert [e.name for e in entries_named("kehoe-3.1")] == ["kehoe-fig-3.1", "kehoe-table-3.1"]
    assert [e.name for e in entries_named("Kehoe Figure 3.23")] == ["kehoe-fig-3.23"]


def test_an_unknown_name_is_refused_with_near_ones() -> None:
    with pytest.raises(UsageError, match=r"kehoe-table-3.9.*kehoe-fig-3.9"):
        entries_named("kehoe-table-3.9")


def test_an_entry_without_run_needs_a_reason() -> None:
    with pytest.raises(ValueError, match="needs a run or a reason"):
        Entry("gatto", "fig", "99", "9", "nothing", "not applicable")
