"""The documentation says what is there: links lead somewhere, examples run, nothing is stale."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import run_program

ROOT = Path(__file__).resolve().parents[2]
_TOP = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
PAGES = sorted([*_TOP, *(ROOT / "docs").glob("**/*.md")])
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
REFERENCE = [page for page in PAGES if page not in TUTORIALS]
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)#\s]+)(#[^)]*)?\)|!\[[^\]]*\]\(([^)\s]+)\)")
_SECTION = re.compile(r"(?<!!)\[[^\]]*\]\(([^)#\s]*)#([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.+)$", re.M)
_CODE = re.compile(r"```(\w+)([^\n]*)\n(.*?)```", re.S)


def _ids(pages: list[Path]) -> list[str]:
    return [str(page.relative_to(ROOT)) for page in pages]


@pytest.mark.parametrize("page", PAGES, ids=_ids(PAGES))
def test_every_relative_link_leads_to_a_file(page: Path) -> None:
    text = _CODE.sub("", page.read_text(encoding="utf-8"))
    targets = [first or picture for first, _, picture in _LINK.findall(text)]
    relative = [target for target in targets if "://" not in target and target]
    missing = [target for target in relative if not (page.parent / target).exists()]
    assert not missing


def _sections(page: Path) -> set[str]:
    """Return what GitHub names the page's headings in links."""
    headings = _HEADING.findall(_CODE.sub("", page.read_text(encoding="utf-8")))
    plain = [re.sub(r"\]\([^)]*\)|[^\w\- ]", "", heading.lower()) for heading in headings]
    return {heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=_ids(PAGES))
def test_every_link_to_a_section_leads_to_its_heading(page: Path) -> None:
    text = _CODE.sub("", page.read_text(encoding="utf-8"))
    inside = [
        ((page.parent / target).resolve() if target else page, section)
        for target, section in _SECTION.findall(text)
        if "://" not in target
    ]
    pages = {path for path, _ in inside if path in PAGES}
    known = {path: _sections(path) for path in pages}
    assert not [f"{p.name}#{name}" for p, name in inside if p in pages and name not in known[p]]


@pytest.mark.slow
@pytest.mark.parametrize("page", REFERENCE, ids=_ids(REFERENCE))
def test_python_examples_of_a_page_run_in_order(page: Path, tmp_path: Path) -> None:
    """A page's ```python blocks run as one program; ```python no-run ones are shown only."""
    blocks = [
        code
        for language, rest, code in _CODE.findall(page.read_text(encoding="utf-8"))
        if language == "python" and "no-run" not in rest and ">>>" not in code
    ]
    if not blocks:
        pytest.skip("no Python example on this page")
    program = tmp_path / "example.py"
    program.write_text("\n".join(blocks), encoding="utf-8")
    if page in _TOP:
        command = [sys.executable, str(program)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    else:  # in a fork of a process that has imported it all, a second of processor time less
        done = run_program(program.read_text("utf-8"), folder=tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]


_PRELUDE = """
set -eo pipefail
trap 'jobs -p | xargs -r kill 2>/dev/null' EXIT
"""


@pytest.mark.slow
@pytest.mark.deep  # `make check` runs them, too
@pytest.mark.parametrize("page", TUTORIALS, ids=_ids(TUTORIALS))
def test_a_tutorial_runs_as_written(page: Path, tmp_path: Path) -> None:
    """All ```sh and ```python blocks run in order in one folder; each Python block on its own."""
    programs = tmp_path / "bin"
    programs.mkdir()
    # Programs and not shell functions: a server in the background is then the shell's own job.
    for name, arguments in (("python", ""), ("rtask", " -m rtask")):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}"{arguments} "$@"\n', "utf-8")
        program.chmod(0o755)
    script = [_PRELUDE]
    for number, (language, rest, code) in enumerate(_CODE.findall(page.read_text("utf-8"))):
        if "no-run" in rest or language not in ("sh", "python"):
            continue
        if language == "python":
            (tmp_path / f"block{number}.py").write_text(code, encoding="utf-8")
            code = f"python block{number}.py"
        script.append(code)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = str(probe.getsockname()[1])
    for file in tmp_path.glob("*.py"):
        file.write_text(file.read_text("utf-8").replace("8765", port), encoding="utf-8")
    text = "\n".join(script).replace("8765", port)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("RTASK_")}
    environment["PYTHONPATH"] = f"{tmp_path}:{ROOT}"
    environment["PATH"] = f"{programs}:{environment['PATH']}"
    done = subprocess.run(
        ["bash", "-c", text],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-1500:]}\n{done.stderr[-2500:]}"


def test_every_page_is_reached_from_the_index() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    folder = ROOT / "docs"
    found = [*folder.glob("*.md"), *folder.glob("tutorials/*.md")]
    pages = [str(page.relative_to(folder)) for page in found if page.name != "index.md"]
    assert not [name for name in pages if f"({name})" not in index]


def test_every_page_of_benchmarks_is_in_their_table() -> None:
    folder = ROOT / "docs"
    table = (folder / "benchmarks.md").read_text(encoding="utf-8")
    pages = [str(page.relative_to(folder)) for page in folder.glob("*/*.md")]
    ours = [name for name in pages if not name.startswith("tutorials/")]
    assert ours
    assert not [name for name in ours if f"({name})" not in table]


def test_the_readme_names_every_room() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rooms = ["ontology", "rtask", "reasoner", "endpoint", "features", "grasp", "simulate", "docs"]
    assert not [room for room in [*rooms, "tests"] if f"`{room}/`" not in readme]


def test_no_page_or_source_names_this_machine() -> None:
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    home = re.compile(r"/(?:home|root|work|Users)/[a-z]")
    guilty = []
    for name in tracked:
        path = ROOT / name
        if path.suffix in {".py", ".md", ".toml", ".ttl", ".html", ".js", ".css"} and path.exists():
            text = path.read_text(encoding="utf-8")
            if home.search(text) and name != "tests/docs/test_docs.py":
                guilty.append(name)
    assert not guilty
