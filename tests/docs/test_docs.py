"""The documentation says what is there: links lead somewhere, examples run, nothing is stale."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_TOP = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
PAGES = sorted([*_TOP, *(ROOT / "docs").glob("**/*.md")])
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)#\s]+)(#[^)]*)?\)|!\[[^\]]*\]\(([^)\s]+)\)")
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


@pytest.mark.parametrize("page", PAGES, ids=_ids(PAGES))
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
    done = subprocess.run(
        [sys.executable, str(program)], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_every_page_is_reached_from_the_index() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = [page.name for page in (ROOT / "docs").glob("*.md") if page.name != "index.md"]
    assert not [name for name in pages if f"({name})" not in index]


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
