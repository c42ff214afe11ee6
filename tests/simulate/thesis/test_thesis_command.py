"""``rtask thesis`` as a reader of the theses uses it."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rtask.cli import main
from simulate.study.declaration import Study
from simulate.thesis import registry
from simulate.thesis.entry import Entry
from simulate.thesis.page import to_html, write_markdown
from simulate.thesis.result import Compared, Result, Setting
from simulate.thesis.running import Outcome, machine, run_entries

_RUN = Entry("kehoe", "fig", "3.9", "3.5", "whiskers", "compared", run="push_figures:part_a")


Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as caught:
            main(["thesis", *arguments])
        return int(caught.value.code or 0), capfd.readouterr().out

    return call


def test_without_a_command_it_lists_with_states(run: Run) -> None:
    code, text = run()
    assert code == 0
    assert "gatto-table-5" in text
    assert "not applicable" in text


def test_a_limited_list_says_how_many_more_there_are(run: Run) -> None:
    code, text = run("list", "--limit", "3", "--json")
    shown = json.loads(text)
    assert code == 0
    assert len(shown["entries"]) == 3
    assert shown["more"] == len(registry.ENTRIES) - 3


def test_an_entry_without_run_says_why(run: Run) -> None:
    code, text = run("show", "gatto-fig-31")
    assert code == 0
    assert "no hardware here" in text


def test_an_unknown_entry_is_a_wrong_call(run: Run) -> None:
    assert run("show", "kehoe-table-9.9")[0] == 2


def test_one_entry_prints_ours_beside_theirs_and_writes_its_picture(
    tmp_path: Path, run: Run
) -> None:
    code, text = run("show", "kehoe-fig-3.9", "--fast", "--save-plots", str(tmp_path))
    assert code == 0
    assert "92.7" in text
    assert "stand-in outlines" in text
    assert "s of the processor" in text
    assert "seed 0" in text
    assert f"Python {platform.python_version()}" in text
    assert (tmp_path / "kehoe-fig-3.9-1.svg").read_text(encoding="utf-8").startswith("<svg")


def test_all_entries_are_run_and_their_report_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    monkeypatch.setattr(registry, "ENTRIES", (_RUN,))
    code, text = run("all", "--fast", "--out", str(tmp_path), "--json")
    done = json.loads(text)
    assert code == 0
    assert done["verdicts"] == {"kehoe-fig-3.9": "different"}
    assert "whiskers" in Path(done["report"]).read_text(encoding="utf-8")
    assert json.loads((tmp_path / "results.jsonl").read_text(encoding="utf-8"))["rows"]


def test_a_run_goes_on_only_where_it_is_asked_to(tmp_path: Path, run: Run) -> None:
    (tmp_path / "trials").mkdir()
    shown = ("show", "kehoe-fig-3.9", "--fast")
    assert run(*shown, "--out", str(tmp_path))[0] == 2
    assert run(*shown, "--resume")[0] == 2
    assert run(*shown, "--out", str(tmp_path), "--resume")[0] == 0


def numbered(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """A trial that takes no time."""
    return {"value": [settings["seed"], number]}


def test_trials_of_a_study_are_kept_and_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Processes of trials find this module by its own name, without the packages around it.
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))

    def study(seed: int, count: int) -> Study:
        return Study("numbers", f"{Path(__file__).stem}:numbered", {"seed": seed}, count)

    here = Setting(journals=tmp_path)
    first = here.trials(study(1, 1))
    again = Setting(journals=tmp_path, resume=True).trials(study(1, 2))
    assert again[0] == first[0]
    assert again == Setting().trials(study(1, 2))
    assert len(list(tmp_path.glob("*/journal.jsonl"))) == 1
    here.trials(study(2, 1))
    assert len(list(tmp_path.glob("*/journal.jsonl"))) == 2


def test_one_entry_as_json_has_its_rows(run: Run) -> None:
    code, text = run("show", "kehoe-fig-3.9", "--fast", "--json")
    assert code == 0
    assert json.loads(text)["entries"][0]["rows"][0]["theirs"] == 92.7


def test_a_run_that_breaks_ends_alone(monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    broken = Entry("kehoe", "fig", "3.1", "3.1", "nothing", "compared", run="push_figures:missing")
    seen: list[str] = []
    outcomes = run_entries([broken, _RUN], Setting(), lambda outcome: seen.append(outcome.verdict))
    assert seen[0] == "failed"
    assert "missing" in outcomes[0].error
    assert outcomes[1].result is not None
    monkeypatch.setattr(registry, "ENTRIES", (broken,))
    assert run("show", "kehoe-fig-3.1")[0] == 3


def test_a_run_that_several_entries_show_is_run_once() -> None:
    twice = [_RUN, Entry("kehoe", "fig", "3.91", "3.5", "same", "compared", run=_RUN.run)]
    first, second = run_entries(twice, Setting(), lambda outcome: None)
    assert first.result is second.result


def test_the_report_holds_figures_notes_pictures_and_reasons(tmp_path: Path) -> None:
    row = Compared("a<b", 0.5, 0.4, "s", (0.45, 0.6), tolerance=0.01, reason="few", better="lower",
                   because="a slow way")  # fmt: skip
    result = Result((row,), ("stand-in",), {"drawn": "<svg></svg>", "seen": b"\x89PNG"})
    none = Entry("gatto", "fig", "31", "5.2", "a photograph", "not applicable", why="no hardware")
    outcomes = [Outcome(_RUN, result, 1.0, 0.5), Outcome(none, None)]
    page = to_html(Setting(), machine(), outcomes)
    for words in ("a&lt;b", "0.5 s [0.45, 0.6]", "worse", "stand-in", "<svg>", "data:image/png",
                  "No hardware", "few", "a slow way"):  # fmt: skip
        assert words in page
    written = write_markdown(tmp_path, Setting(), machine(), outcomes).read_text(encoding="utf-8")
    assert "| a<b | 0.5 s [0.45, 0.6] | 0.4 s | worse | stand-in outlines |" in written
    worse = written.index("## Worse than the theses")
    assert worse < written.index("| kehoe-fig-3.9 | a<b |") < written.index("## Kehoe 2014")
    assert "a<b: tolerance 0.01: few" in written
    assert (tmp_path / "images" / "theses" / "kehoe-fig-3.9.svg").exists()
