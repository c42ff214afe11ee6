"""Fixtures that tests of several rooms use."""

from __future__ import annotations

import contextlib
import gc
import importlib
import inspect
import os
import random
import tempfile
import warnings
from collections.abc import Generator
from pathlib import Path

import httpx
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

from tests import prewarmed

_MAX_CPU_S = 5.0
_DEEP_S, _SLOW_S, _QUICK_S = 10.0, 2.0, 0.02
_GC_THRESHOLDS = (20_000, 50, 1_000)
_PATIENCE_S = 60.0
_ROOT = Path(__file__).resolve().parent.parent
_FAILED = pytest.StashKey[Path]()

# Several processes of tests share the processors. Threads of one library that wait for each other
# in a loop took up to half of the time, and sums would depend on how many processors there are.
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer to run tests in an order that nobody chose."""
    text = "shuffle modules, and the tests within each, with this seed"
    parser.addoption("--shuffle", type=int, default=None, metavar="SEED", help=text)


def pytest_report_header(config: pytest.Config) -> str | None:
    """Say with which seed the tests are shuffled, so that the order can be had again."""
    seed = config.getoption("--shuffle")
    return None if seed is None else f"shuffled with --shuffle={seed}"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Shuffle tests if asked to; among several processes, begin with the modules that take longest.

    A module stays in one piece, so that it is set up once. A long one that began last would leave
    the other processes idle.
    """
    modules: dict[str, list[pytest.Item]] = {}
    for item in items:
        modules.setdefault(item.nodeid.partition("::")[0], []).append(item)
    seed = config.getoption("--shuffle")
    if seed is not None:
        chance = random.Random(seed)
        pieces = [chance.sample(piece, len(piece)) for piece in modules.values()]
        items[:] = [item for piece in chance.sample(pieces, len(pieces)) for item in piece]
    elif hasattr(config, "workerinput"):
        by_length = sorted(modules.values(), key=_estimated_s, reverse=True)
        items[:] = [item for piece in by_length for item in piece]


def _estimated_s(piece: list[pytest.Item]) -> float:
    """Estimate how many seconds the tests of a module take, from how they are marked."""
    deep = sum(1 for item in piece if item.get_closest_marker("deep"))
    slow = {
        getattr(item, "originalname", item.name)
        for item in piece
        if item.get_closest_marker("slow")
    }
    return _DEEP_S * deep + _SLOW_S * len(slow) + _QUICK_S * len(piece)


def pytest_configure(config: pytest.Config) -> None:
    """Prepare what all tests share: a place for temporary files, and patient requests.

    httpx waits 5 s for an answer, too short for a busy machine, and reads all certificates for each
    request, 20 ms; so there is one TLS context.
    """
    if not hasattr(config, "workerinput"):
        _gather_temporary_files(config)
    _draw_the_same_everywhere()
    usual = inspect.signature(httpx.Client).parameters["timeout"].default
    usual.connect = usual.read = usual.write = usual.pool = _PATIENCE_S
    context = httpx.create_ssl_context()
    short = (httpx.get, httpx.head, httpx.options, httpx.delete, httpx.request, httpx.stream)
    sends = (httpx.post, httpx.put, httpx.patch)
    for call in (*short, *sends, httpx.Client.__init__, httpx.AsyncClient.__init__):
        inspect.unwrap(call).__kwdefaults__["verify"] = context
    failed = os.environ.pop("RTASK_FAILED_TESTS", None)
    if failed and not hasattr(config, "workerinput"):
        config.stash[_FAILED] = Path(failed)


def _draw_the_same_everywhere() -> None:
    """Let hypothesis draw the same examples on every machine, in whatever time they take.

    Otherwise it does so only where it recognises a service for continuous integration; elsewhere a
    busy processor fails what takes more than .2 s, and other examples are drawn each time.

    Nor does it draw from the numbers and strings of our own source, as it does by itself: to read
    them takes a quarter of the time of collecting in each process, and what a test draws would
    change with any number in any module that happens to be imported.
    """
    settings.register_profile(
        "tests", deadline=None, derandomize=True, database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )  # fmt: skip
    settings.load_profile("tests")
    providers._get_local_constants = lambda: providers._local_constants


def _gather_temporary_files(config: pytest.Config) -> None:
    """Let tests and the processes that they start make temporary files in one folder.

    It goes at the end with all that killed processes left in it, or, if these tests are killed, at
    the beginning of the next ones. The folders of ``tmp_path`` stay where they were, for a look at
    them after a failure.
    """
    from rtask.scratch import ScratchFolder

    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
    folder = ScratchFolder("tests")
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder.path)
    # Robots and stores that whoever runs the tests has added for himself are none of theirs.
    os.environ["XDG_DATA_HOME"] = str(folder.path / "data")
    config.add_cleanup(folder.close)


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Let each of several processes import a share of the test modules first.

    Nobody has compiled them in a new checkout, which takes 25 s of processor time in each process
    that compiles all of them; so each finds most of them compiled by the others.
    """
    worker = getattr(session.config, "workerinput", None)
    if worker is None:
        return
    number, count = int(worker["workerid"].removeprefix("gw")), int(worker["workercount"])
    for path in _test_modules(session.config)[number::count]:
        name = ".".join(path.relative_to(_ROOT).with_suffix("").parts)
        # What fails here fails again where it is collected, and is reported there.
        with (
            warnings.catch_warnings(action="error"),
            contextlib.suppress(Exception, pytest.skip.Exception),
        ):
            importlib.import_module(name)


def _test_modules(config: pytest.Config) -> list[Path]:
    """Return the test modules that are asked for by folder, in the order of their paths."""
    folders = [_ROOT / argument for argument in config.args]
    found = {path for folder in folders for path in folder.rglob("test_*.py")}
    return sorted(path for path in found if "benchmarks" not in path.parts)


def pytest_collection_finish() -> None:
    """Exempt all that collection created from garbage collection, and let it begin more rarely.

    The first halves its cost; the second saves a fifteenth of all processor time. New knowledge
    bases are copied from now on, which saves as much.
    """
    from tests.opened import open_by_copying

    open_by_copying()
    gc.collect()
    gc.freeze()
    gc.set_threshold(*_GC_THRESHOLDS)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Note how much of the processors a test and the processes that it has ended took."""
    before = _cpu_s()
    try:
        return (yield)
    finally:
        item.user_properties.append(("cpu_s", _cpu_s() - before))


def _cpu_s() -> float:
    own = os.times()
    forked = prewarmed.spent["cpu_s"]
    return own.user + own.system + own.children_user + own.children_system + forked


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Write the names of the tests that failed where `.ci/run` reads them, if all tests ran.

    Of a module whose set-up failed its own name is written, once for all its tests.
    """
    file = session.config.stash.get(_FAILED, None)
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if file is None or reporter is None or exitstatus != pytest.ExitCode.TESTS_FAILED:
        return
    names = {
        report.nodeid.partition("::")[0] if report.when == "setup" else report.nodeid
        for kind in ("failed", "error")
        for report in reporter.stats.get(kind, [])
    }
    file.write_text("".join(f"{name}\n" for name in sorted(names)), "utf-8")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List the tests that exceed the budget of processor time and are not marked as deep."""
    took = {
        report.nodeid: cpu_s
        for reports in terminalreporter.stats.values()
        for report in reports
        if isinstance(report, pytest.TestReport) and report.when == "call"
        if "deep" not in report.keywords
        for name, cpu_s in report.user_properties
        if name == "cpu_s" and cpu_s > _MAX_CPU_S
    }
    if took:
        title = f"above {_MAX_CPU_S:.0f} s of processor time and not marked deep"
        terminalreporter.section(title)
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
