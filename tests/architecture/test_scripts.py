"""Scripts of pages stay few, short and light."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import pytest

PAGES = Path(__file__).parents[2] / "endpoint" / "pages"
SCRIPTS = PAGES / "static" / "js"
MAX_LINES, MAX_TOTAL_LINES = 400, 4_000
MAX_OWN_BYTES = 30_000
"""Of a page's own scripts, compressed."""
MAX_BUNDLE_BYTES = {"editor.js": 150_000, "clouds.js": 160_000}
_IMPORTED = re.compile(r'(?:from|import)\s+"\./([\w.]+)"')
_NAMED = re.compile(r"filename='js/([\w.]+)'")


def _loaded(names: set[str]) -> set[str]:
    """Return the scripts that load when some do."""
    found = set(names)
    for name in names:
        text = (SCRIPTS / name).read_text(encoding="utf-8")
        found |= _loaded(set(_IMPORTED.findall(text)) - found)
    return found


def test_each_script_fits_its_bounds_and_so_do_all_together() -> None:
    lines = {path.name: len(path.read_text("utf-8").splitlines()) for path in SCRIPTS.iterdir()}
    assert {name: count for name, count in lines.items() if count >= MAX_LINES} == {}
    assert sum(lines.values()) < MAX_TOTAL_LINES


def test_every_page_loads_few_bytes_of_script() -> None:
    base = set(_NAMED.findall((PAGES / "templates" / "base.html").read_text("utf-8")))
    heavy = {}
    for template in (PAGES / "templates").glob("*.html"):
        names = _loaded(base | set(_NAMED.findall(template.read_text("utf-8"))))
        size = sum(len(gzip.compress((SCRIPTS / name).read_bytes())) for name in names)
        if size > MAX_OWN_BYTES:
            heavy[template.name] = size
    assert base
    assert heavy == {}


@pytest.mark.parametrize("name", MAX_BUNDLE_BYTES)
def test_bundled_libraries_are_no_heavier_than_was_agreed(name: str) -> None:
    bundle = PAGES / "static" / "vendor" / name
    if not bundle.exists():
        pytest.skip("bundling needs npm at set-up")
    assert len(gzip.compress(bundle.read_bytes())) <= MAX_BUNDLE_BYTES[name]
