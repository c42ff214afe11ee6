"""A recorded demo: packed into one file after a run, and shown without robots or any extra."""

from __future__ import annotations

import io
import json
import shutil
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import click

from rtask.errors import RtaskError, UsageError
from rtask.scratch import ScratchFolder
from simulate.demo.processes import Endpoint, run_rtask
from simulate.demo.report_page import report_page

__all__ = ["MARK", "RECORDED", "pack", "show", "unpack"]

RECORDED = Path(__file__).with_name("recorded.tar.xz")
"""The demo that is shipped with the package."""

MARK = "recorded.json"
_STORE, _REPORT = "store", "report"
_QUESTIONS = (
    "which robot fails at cartons, and why?",
    "how was each carton grasped?",
)


def pack(data: Path, archive: Path) -> None:
    """Pack store and report of a finished demo; names of folders and users stay out.

    Parameters
    ----------
    data
        Folder of the demo, whose server has ended.
    archive
        Receives the file, ``.tar.xz``.
    """
    result = json.loads((data / _REPORT / "report.json").read_text("utf-8"))
    result |= {"store": _STORE, "url": ""}
    with ScratchFolder("record") as copy:
        run_rtask("backup", "--data", str(data / _STORE), str(copy / _STORE))
        shutil.copytree(data / _REPORT, copy / _REPORT)
        text = json.dumps(result, indent=1) + "\n"
        (copy / _REPORT / "report.json").write_text(text, "utf-8")
        (copy / MARK).write_text(text, "utf-8")
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w:xz", preset=9) as tar:
            for path in sorted(copy.rglob("*")):
                tar.add(path, str(path.relative_to(copy)), recursive=False, filter=_anonymous)
    archive.write_bytes(packed.getvalue())


def _anonymous(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    entry.uid = entry.gid = 0
    entry.uname = entry.gname = ""
    entry.mtime = 0
    return entry


def unpack(folder: Path, archive: Path = RECORDED) -> dict[str, Any]:
    """Unpack a recorded demo, unless it is there already; return what ``--json`` printed.

    The page of its report is drawn as this version does it.

    Parameters
    ----------
    folder
        New, empty, or one that holds a recorded demo, which is kept with what was judged since.

    Raises
    ------
    UsageError
        The folder holds something else.
    RtaskError
        There is no recorded demo in this installation.
    """
    mark = folder / MARK
    if not mark.exists():
        if folder.exists() and any(folder.iterdir()):
            raise UsageError(
                f"{folder} exists and holds no recorded demo; name another with --data"
            )
        if not archive.exists():
            raise RtaskError(f"{archive} is missing; `rtask demo --record FILE` makes such a file")
        folder.parent.mkdir(parents=True, exist_ok=True)
        # Beside it first: a half of it would be taken for the whole the next time.
        with ScratchFolder("recorded", folder.parent) as place:
            whole = place / "whole"
            with tarfile.open(archive) as tar:
                tar.extractall(whole, filter="data")
            whole.replace(folder)
    result: dict[str, Any] = json.loads(mark.read_text("utf-8"))
    page = report_page(folder / _REPORT, result)
    (folder / _REPORT / "report.html").write_text(page, "utf-8")
    return result | {"store": str(folder / _STORE)}


def show(folder: Path, port: int, as_json: bool) -> None:
    """Show the recorded demo: what happened, its report, and a server until Ctrl-C.

    Parameters
    ----------
    folder
        See :func:`unpack`.
    port
        Of the server; 0 = any that is free.
    as_json
        Print the recorded result instead, and start no server.
    """
    from simulate.demo.story import opening, outcome

    result = unpack(folder)
    if as_json:
        click.echo(json.dumps(result))
        return
    robots, alone = ([robot["name"] for robot in result[key]] for key in ("robots", "alone_robots"))
    secret, watch = opening(result["products"], robots, alone)
    click.echo(f"A recorded run. {secret}\n{watch.replace('Watch:', 'You see:')}\n")
    click.echo(f"{outcome(result)}\n")
    server = Endpoint(folder / _STORE, port, folder / "endpoint.log")
    try:
        for line in _ways_on(folder, server.url, result):
            click.echo(line)
        server.process.wait()
        raise RtaskError(f"the endpoint went away: {server.complaint()}")
    finally:
        server.stop()


def _ways_on(folder: Path, url: str, result: Mapping[str, Any]) -> list[str]:
    """Return what to open and to ask, a line each."""
    lines = [
        f"report  {folder / _REPORT / 'report.html'}",
        f"pages   {url}/",
        f"film    {url}/feedback  (each attempt in pictures)",
    ]
    first = next((met for met in result["objects"] if met["object_iri"]), None)
    if first is not None:
        lines.append(f"object  {url}/object?iri={quote(first['object_iri'], safe='')}")
    lines += [f"ask     {url}/ask?text={quote(question)}" for question in _QUESTIONS]
    return [*lines, "Ctrl-C ends it. `rtask demo` runs the robots, with the extra 'simulate'."]
