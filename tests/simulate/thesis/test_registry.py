"""The list of tables and figures, against the theses' texts and against this project."""

from __future__ import annotations

import importlib
import os
import re
from pathlib import Path

import click
import pytest

from rtask.cli import cli
from rtask.errors import UsageError
from simulate.thesis.entry import Entry
from simulate.thesis.registry import ENTRIES, entries_named

_ROOT = Path(__file__).resolve().parents[3]
_TEXTS = Path(os.environ.get("RTASK_SHARED_DATA", _ROOT / "shared" / "data")).parent / "seeds"
_CAPTIONED = {
    "gatto": [("table", range(1, 6)), ("fig", range(1, 32))],
    "kehoe": [
        ("fig", ["1.1"]),
        ("fig", [f"2.{n}" for n in range(1, 13)]),
        ("fig", [f"3.{n}" for n in range(1, 24)]),
        ("fig", [f"4.{n}" for n in range(1, 11)]),
        ("fig", [f"5.{n}" for n in range(1, 6)]),
        ("table", ["3.1", "3.2", "4.1", "4.2", "4.3"]),
        ("algorithm", range(1, 3)),
    ],
}
"""Numbers of all captions of either book; the test below counts them in its text."""
_CAPTION = re.compile(r"^\W*(Figure|Table|Algorithm) (\d+(?:\.\d+)?):", re.MULTILINE)


_NAMES = {
    thesis: {f"{thesis}-{kind}-{number}" for kind, numbers in kinds for number in numbers}
    for thesis, kinds in _CAPTIONED.items()
}


@pytest.mark.parametrize("thesis", ["gatto", "kehoe"])
def test_every_captioned_number_has_an_entry_and_no_other_does(thesis: str) -> None:
    numbered = {
        entry.name
        for entry in ENTRIES
        if entry.thesis == thesis and entry.kind in ("table", "fig", "algorithm")
    }
    assert numbered == _NAMES[thesis]


@pytest.mark.parametrize(("thesis", "file"), [("gatto", "000_*"), ("kehoe", "002_*")])
def test_the_numbers_are_those_of_the_text(thesis: str, file: str) -> None:
    texts = list(_TEXTS.glob(f"{file}.txt")) if _TEXTS.is_dir() else []
    if not texts:
        pytest.skip("the theses' texts are not here")
    text = texts[0].read_text(encoding="utf-8")
    captions = {
        f"{thesis}-{kind.lower().replace('figure', 'fig')}-{number}"
        for kind, number in _CAPTION.findall(text)
    }
    assert captions == _NAMES[thesis]


@pytest.mark.parametrize(
    "entry", [e for e in ENTRIES if e.run and e.thesis != "beyond"], ids=lambda e: e.name
)
def test_every_run_says_what_its_rows_are_measured_on(entry: Entry) -> None:
    assert entry.stand_in


def test_names_are_unique() -> None:
    names = [entry.name for entry in ENTRIES]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("run", sorted({entry.run for entry in ENTRIES if entry.run}))
def test_every_run_exists(run: str) -> None:
    module, _, function = run.partition(":")
    assert callable(getattr(importlib.import_module(f"simulate.thesis.runs.{module}"), function))


@pytest.mark.parametrize("entry", [e for e in ENTRIES if e.why], ids=lambda e: e.name)
def test_what_a_reason_names_exists(entry: Entry) -> None:
    for path in re.findall(r"(?:docs|tests|features|simulate)/[\w./-]*\w", entry.why):
        assert (_ROOT / path).exists(), path
    for typed in re.findall(r"`rtask ([^`]*)`", entry.why):
        assert_is_a_command(typed.split())
    for name in re.findall(r"(?:gatto|kehoe)-[a-z]+-[\w.]+", entry.why):
        assert entries_named(name.rstrip("."))


def assert_is_a_command(words: list[str]) -> None:
    command: click.Command = cli
    for word in words:
        if word.startswith("--"):
            assert word in {option for p in command.params for option in p.opts}, words
        elif isinstance(command, click.Group):
            step = command.get_command(click.Context(command), word)
            assert step is not None, words
            command = step


def test_a_promise_without_a_caption_is_answered_too() -> None:
    promises = {e.name for e in ENTRIES if e.kind == "capability" and e.thesis != "beyond"}
    assert {"gatto-capability-other-tasks", "kehoe-capability-call-centre"} <= promises
    assert all(e.why for e in ENTRIES if e.name in promises)


def test_a_number_means_all_that_carry_it() -> None:
    assert [e.name for e in entries_named("kehoe-3.1")] == ["kehoe-fig-3.1", "kehoe-table-3.1"]
    assert [e.name for e in entries_named("Kehoe Figure 3.23")] == ["kehoe-fig-3.23"]


def test_an_unknown_name_is_refused_with_near_ones() -> None:
    with pytest.raises(UsageError, match=r"kehoe-table-3.9.*kehoe-fig-3.9"):
        entries_named("kehoe-table-3.9")


def test_an_entry_without_run_needs_a_reason() -> None:
    with pytest.raises(ValueError, match="needs a run or a reason"):
        Entry("gatto", "fig", "99", "9", "nothing", "not applicable")
