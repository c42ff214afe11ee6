"""``rtask doctor``: say what is wrong with a machine, and the command that mends it."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import re
import shutil
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import click

from rtask.extras import install_command

_OPEN3D_PACKAGES = "libgl1 libegl1 libusb-1.0-0 libgomp1 libx11-6"
# An extra, its library that most often does not load, and what mends that.
_EXTRAS = (
    ("perception", "cv2", "pip install --force-reinstall opencv-python-headless"),
    ("surfaces", "open3d", f"sudo apt-get install {_OPEN3D_PACKAGES}"),
    ("simulate", "pybullet", "pip install --force-reinstall pybullet"),
)
_FIRST_KERNELS = (
    "features.codec.differences",
    "features.segmentation",
    "features.recognition",
    "reasoner",
)
"""Modules with kernels that a robot needs to see and recognise what it is to grasp."""
_LATER_KERNELS = (
    "features.modelling",
    "grasp.spatial.grasp_plan",
    "features.scene_change",
    "grasp.push",
)
_IMPORT_TIMEOUT_S = 120
_MIN_FREE_BYTES = 2 * 1024**3


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    Parameters
    ----------
    name
        What was looked at.
    state
        ``ok``; ``note`` = works, with less; ``broken`` = must be mended.
    detail
        What was found.
    mend
        The command or action that mends it; empty when there is nothing to mend.
    """

    name: str
    state: str
    detail: str
    mend: str = ""


def _python() -> Finding:
    return Finding("python", "ok", f"{'.'.join(map(str, sys.version_info[:3]))} at {sys.prefix}")


def _imports(module: str, mend: str, state: str = "broken") -> Finding:
    """Import in a child process: a missing system library may end the process that loads it."""
    try:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", f"import {module}"],
            capture_output=True,
            text=True,
            timeout=_IMPORT_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Finding(module, state, f"import took over {_IMPORT_TIMEOUT_S} s", mend)
    if done.returncode == 0:
        return Finding(module, "ok", "imports")
    last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    return Finding(module, state, last, mend)


def _missing(extra: str | None) -> list[str]:
    """Return the distributions that are not installed, of an extra or of the base."""
    missing = []
    for text in importlib.metadata.requires("rtask-kg") or []:
        requirement, _, marker = (part.strip() for part in text.partition(";"))
        if (f"extra == '{extra}'" not in marker) if extra else ("extra ==" in marker):
            continue
        if "sys_platform != 'win32'" in marker and sys.platform == "win32":
            continue
        name = re.split(r"[\s<>=!~\[]", requirement)[0]
        try:
            importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    return missing


def _packages() -> Finding:
    missing = _missing(None)
    if missing:
        return Finding("packages", "broken", f"missing: {', '.join(missing)}", install_command())
    return Finding("packages", "ok", "all installed")


def _extra(name: str) -> Finding:
    missing = _missing(name)
    if missing:
        lacks = f"the extra lacks {', '.join(missing)}"
        return Finding(name, "note", lacks, install_command(name))
    return Finding(name, "ok", "the extra is installed")


def _java() -> Finding:
    if shutil.which("java"):
        return Finding("java", "ok", "HermiT can run")
    return Finding(
        "java",
        "note",
        "not found: DL classification with HermiT is off, everything else works",
        "sudo apt-get install default-jre-headless",
    )


def _display() -> Finding:
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return Finding("display", "ok", "--gui can open a window")
    return Finding("display", "note", "none: --gui is refused, everything else runs headless")


def _sqlite() -> Finding:
    with sqlite3.connect(":memory:") as connection:
        try:
            connection.execute("CREATE VIRTUAL TABLE t USING fts5(x)")
        except sqlite3.OperationalError:
            return Finding(
                "sqlite", "note", "built without FTS5: no text search", "use Debian's python3"
            )
    return Finding("sqlite", "ok", f"{sqlite3.sqlite_version} with FTS5")


def _cache() -> Finding:
    """Compiled kernels are kept beside the package; without that each start compiles again."""
    spec = importlib.util.find_spec("features")
    folder = Path(spec.origin).parent if spec and spec.origin else Path.cwd()
    if os.access(folder, os.W_OK) or os.environ.get("NUMBA_CACHE_DIR"):
        return Finding("kernel cache", "ok", "writable")
    return Finding(
        "kernel cache",
        "note",
        "read-only package folder: kernels are compiled at each start",
        "export NUMBA_CACHE_DIR=~/.cache/rtask",
    )


def _disk(folder: Path) -> Finding:
    probe = next(p for p in [folder, *folder.absolute().parents] if p.exists())
    free = shutil.disk_usage(probe).free
    if free >= _MIN_FREE_BYTES:
        return Finding("disk", "ok", f"{free / 1e9:.0f} GB free")
    return Finding("disk", "broken", f"{free / 1e9:.1f} GB free at {probe}", "make room: 2 GB")


def _port(port: int) -> Finding:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            return Finding(f"port {port}", "note", f"in use ({error.strerror})", "rtask serve -p 0")
    return Finding(f"port {port}", "ok", "free")


def _store(folder: Path) -> Finding:
    import rtask
    from rtask.errors import RtaskError

    if not folder.exists():
        return Finding("store", "note", f"{folder} does not exist yet", f"rtask load -d {folder}")
    try:
        with rtask.open(folder, mode="r") as kb:
            return Finding("store", "ok", f"{kb.stats()['triples']} triples")
    except RtaskError as error:
        remedy = f"rtask verify -d {folder}" if error.details.get("recover") else ""
        return Finding("store", "broken", str(error), remedy)


def examine_clock(folder: Path) -> Finding:
    """Name the commits between which the clock went back, and those that lie in the future."""
    from rtask.errors import RtaskError
    from rtask.kb.durability.journal import JournalFile
    from rtask.kb.feed.history import clock_jumps

    if not (folder / "journal").is_dir():
        return Finding("clock", "ok", "no commits yet")
    journal = JournalFile(folder / "journal")
    try:
        jumps = list(clock_jumps(journal))
    except RtaskError as error:
        return Finding("clock", "note", f"the times of commits cannot be read: {error}")
    finally:
        journal.close()
    if not jumps:
        return Finding("clock", "ok", "the times of commits follow their order")
    shown = [f"{jump.back_s:.0f} s at commit {jump.seq} ({jump.time[:19]})" for jump in jumps[-3:]]
    more = f", and {len(jumps) - 3} times before" if len(jumps) > 3 else ""
    return Finding(
        "clock",
        "note",
        f"went back by {', '.join(shown)}{more}; commits are ordered by number, their times are as "
        "the clock had them",
        "synchronise the clock: timedatectl set-ntp true",
    )


def _axioms(folder: Path) -> Finding:
    """Axioms about others' terms in the graphs of robots, from before these needed a right."""
    import rtask
    from rtask.errors import RtaskError
    from rtask.kb.commit.schema_right import stored_axioms

    if not folder.exists():
        return Finding("axioms", "ok", "none of robots")
    try:
        with rtask.open(folder, mode="r") as kb:
            axioms = list(stored_axioms(kb.store, kb.graphs, kb.catalogue.declared()))
    except RtaskError:
        return Finding("axioms", "note", "not looked at: the store does not open")
    if not axioms:
        return Finding("axioms", "ok", "none of robots about terms of others")
    name, first = axioms[0]
    statement = f"{first.subject} {first.predicate} {first.object}"
    detail = f"{len(axioms)} of robots about terms of others, e.g. {name}: {statement}"
    return Finding("axioms", "note", detail, "keep them, or remove them with rtask update")


def _contested(folder: Path) -> Finding:
    """Values of keys that things of several robots have, of which one may be wrong."""
    import rtask
    from rtask.errors import RtaskError
    from rtask.kb.commit.foreign.claims import contested_keys

    if not folder.exists():
        return Finding("keys", "ok", "none contested")
    try:
        with rtask.open(folder, mode="r") as kb:
            contested = contested_keys(kb.store, kb.graphs)
    except RtaskError:
        return Finding("keys", "note", "not looked at: the store does not open")
    if not contested:
        return Finding("keys", "ok", "none contested")
    return Finding(
        "keys",
        "note",
        f"{len(contested)} contested, e.g. {contested[0]}",
        "withdraw the wrong one, or state with rtask update that they are the same (owl:sameAs)",
    )


def _set_aside(folder: Path) -> Finding:
    """Statements in quarantine, which contradicted others or those of a name's owner."""
    import rtask
    from rtask.errors import RtaskError

    if not folder.exists():
        return Finding("quarantine", "ok", "empty")
    try:
        with rtask.open(folder, mode="r") as kb:
            held = kb.quarantined()
            authors = sorted({kb.graphs.owner(h.quad.graph_name) or "others" for h in held})
    except RtaskError:
        return Finding("quarantine", "note", "not looked at: the store does not open")
    if not held:
        return Finding("quarantine", "ok", "empty")
    detail = f"{len(held)} statements of {', '.join(authors)}, e.g. because {held[-1].reason}"
    return Finding("quarantine", "note", detail, f"see rtask quarantine -d {folder}")


def examine(data: Path | None, port: int) -> Iterator[Finding]:
    """Look at everything, cheapest first."""
    checks: list[Callable[[], Finding]] = [
        _python,
        _packages,
        _sqlite,
        _java,
        _display,
        _cache,
        lambda: _disk(data or Path.cwd()),
        lambda: _port(port),
    ]
    for extra, module, mend in _EXTRAS:
        checks.append(partial(_extra, extra))
        if importlib.util.find_spec(module) is not None:
            checks.append(partial(_imports, module, mend))
    if data is not None:
        checks.append(lambda: _store(data))
        checks.append(lambda: examine_clock(data))
        checks.append(lambda: _axioms(data))
        checks.append(lambda: _contested(data))
        checks.append(lambda: _set_aside(data))
    for check in checks:
        yield check()


def warm_up(modules: Iterable[str] = (*_FIRST_KERNELS, *_LATER_KERNELS)) -> None:
    """Compile the numeric kernels of modules once; numba keeps them on disk.

    Raises
    ------
    MissingExtraError
        The extra ``perception``, which brings numba, is not installed.
    """
    for module in modules:
        loaded = importlib.import_module(module)
        compile_all = getattr(loaded, "warm_up", None)
        if compile_all is not None:
            compile_all()


def warm_up_later() -> int:
    """Compile what no first grasp needs in a process of low priority; return its number.

    It outlives this one. What is used before it got there is compiled on that use.
    """
    call = (
        f"import os; os.nice(10); from rtask.cli.doctor import warm_up; warm_up({_LATER_KERNELS})"
    )
    return subprocess.Popen(
        [sys.executable, "-c", call],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ).pid


def print_findings(examined: Iterable[Finding], quiet: bool, as_json: bool) -> None:
    """Print each finding as it comes.

    Parameters
    ----------
    quiet
        Print only what is broken.
    as_json
        Print one list at the end instead.

    Raises
    ------
    SystemExit
        With code 1, after all of them, if something is broken.
    """
    findings = []
    for finding in examined:
        findings.append(finding)
        if as_json or (quiet and finding.state != "broken"):
            continue
        click.echo(f"{finding.state:7s} {finding.name:13s} {finding.detail}")
        if finding.mend and finding.state != "ok":
            click.echo(f"{'':7s} {'':13s} mend: {finding.mend}")
    if as_json:
        click.echo(json.dumps([asdict(f) for f in findings], indent=2))
    if any(f.state == "broken" for f in findings):
        raise SystemExit(1)


@click.command()
@click.option("--data", "-d", type=click.Path(path_type=Path), help="Also look at this store.")
@click.option("--port", "-p", default=8765, show_default=True, help="Port that serve would use.")
@click.option("--warm-up", "warm", is_flag=True, help="Compile the numeric kernels as well.")
@click.option(
    "--background", is_flag=True,
    help="With --warm-up: compile what no first grasp needs in the background.",
)  # fmt: skip
@click.option("--quiet", "-q", is_flag=True, help="Print only what is broken.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON list.")
def doctor(
    data: Path | None, port: int, warm: bool, background: bool, quiet: bool, as_json: bool
) -> None:
    """Say what is wrong with this machine, and the command that mends it.

    Exit code 1 when something must be mended; notes do not count.
    """
    if background and not warm:
        raise click.UsageError("--background is about compiling: give --warm-up as well")
    print_findings(examine(data, port), quiet, as_json)
    if background:
        warm_up(_FIRST_KERNELS)
        warm_up_later()
    elif warm:
        warm_up()
