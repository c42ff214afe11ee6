"""Fixtures that tests of several rooms use."""

from __future__ import annotations

import gc
import inspect
import os
from pathlib import Path

import httpx
import pytest

_MAX_QUICK_S = 10.0
_PATIENCE_S = 60.0
_ROOT = Path(__file__).resolve().parent.parent


def pytest_configure() -> None:
    """Let requests without a time limit of their own wait for a busy machine; httpx waits 5 s."""
    usual = inspect.signature(httpx.Client).parameters["timeout"].default
    usual.connect = usual.read = usual.write = usual.pool = _PATIENCE_S


def pytest_collection_finish() -> None:
    """Exempt all that collection created from garbage collection, which halves its cost."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List the tests that took more than ten seconds and are not marked as slow."""
    took = {
        report.nodeid: report.duration
        for reports in terminalreporter.stats.values()
        for report in reports
        if isinstance(report, pytest.TestReport) and report.when == "call"
        if report.duration > _MAX_QUICK_S and "slow" not in report.keywords
    }
    if took:
        terminalreporter.section("above ten seconds and not marked slow")
        for name, seconds in sorted(took.items(), key=lambda item: -item[1]):
            terminalreporter.line(f"{seconds:6.1f} s  {name}")


@pytest.fixture
def shares(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Return a list of what commands tell the line on a terminal: how much is done, of how much."""
    from rtask.cli.progress import Working

    told: list[tuple[int, int]] = []
    monkeypatch.setattr(Working, "tell", lambda _, done, wanted: told.append((done, wanted)))
    return told


def _beside(folder: str) -> Path:
    """Return a folder of data that are not ours to ship, or skip with the reason.

    ``RTASK_SHARED_DATA`` names the folder that holds ``ycb``, ``mosd_learn`` and ``ontologies``
    directly, ``conformance`` beside it; otherwise ``shared/`` next to the checkout is looked at.
    """
    named = os.environ.get("RTASK_SHARED_DATA")
    data = Path(named) if named else _ROOT.parent / "shared" / "data"
    found = (data / folder).resolve()
    if not found.exists():
        pytest.skip(f"{folder} not found; set RTASK_SHARED_DATA to the folder that holds it")
    return found


@pytest.fixture(scope="session")
def ycb_dir() -> Path:
    """78 textured household objects of the YCB Object and Model Set (Calli et al. 2015)."""
    return _beside("ycb")


@pytest.fixture(scope="session")
def mosd_dir() -> Path:
    """45 real Kinect table scenes with labels (modified OSD, Richtsfeld et al. 2012)."""
    return _beside("mosd_learn")


@pytest.fixture(scope="session")
def ontologies_dir() -> Path:
    """Real OWL files in many syntaxes."""
    return _beside("ontologies")


@pytest.fixture(scope="session")
def conformance_dir() -> Path:
    """The W3C's own test cases (w3c/rdf-tests)."""
    return _beside("../conformance")
