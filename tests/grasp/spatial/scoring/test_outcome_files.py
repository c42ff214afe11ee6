"""Files of a hand's own outcomes."""

from __future__ import annotations

from pathlib import Path

import pytest

from grasp.spatial.scoring.outcome_files import read_outcomes
from grasp.spatial.scoring.promises import Promises

GOOD = '{"rank": 1, "lift": 0.9, "carry": 0.6, "load": 0.3, "lifted": true, "carried": false}'


def test_lines_as_printed_with_what_happened_move_all_that_is_promised(tmp_path: Path) -> None:
    path = tmp_path / "own.jsonl"
    path.write_text(f'{GOOD}\n\n{{"lift": 0.5, "lifted": false, "carried": null}}\n')
    first, second = read_outcomes(path)
    assert first == ({"lift": 0.9, "carry": 0.6, "load": 0.3}, {"lift": True, "carry": False})
    assert second == ({"lift": 0.5}, {"lift": False})
    before, after = Promises(), Promises().after([first] * 40)
    scores = {"lift": 0.9, "carry": 0.6, "load": 0.3}
    less = [after.of(scores)[name] < before.of(scores)[name] for name in before.of(scores)]
    assert less == [False, False, True, True]
    assert after.outcomes == 40


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{", "line 2: "),
        ("[1]", "line 2: expected an object"),
        ('{"lift": 0.5}', "neither lifted nor carried"),
        ('{"lift": 1.5, "lifted": true}', "lift: expected 0 to 1, got 1.5"),
        ('{"lift": NaN, "lifted": true}', "lift: expected 0 to 1"),
        ('{"lift": 0.5, "load": Infinity, "lifted": true}', "load: expected 0 to inf"),
        ('{"lift": true, "lifted": true}', "lift: expected a number"),
        ('{"lift": 0.5, "lifted": 1}', "lifted: expected true or false, got 1"),
        ('{"lift": 0.5, "carried": true}', "not the score carry"),
        ("[" * 100_000, "line 2: "),
    ],
)
def test_a_line_that_says_nothing_is_named(tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "own.jsonl"
    path.write_text(f"{GOOD}\n{line}\n")
    with pytest.raises(ValueError, match=words):
        read_outcomes(path)


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "own.jsonl").write_text("\n")
    with pytest.raises(ValueError, match="no outcome"):
        read_outcomes(tmp_path / "own.jsonl")
