"""One Chromium for the pages; ``RTASK_REQUIRE_BROWSER=1`` turns a missing one into a failure."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# Chromium without windows takes a third of the processor time of the whole one.
CHROMIUM = (
    shutil.which("chromium-headless-shell") or shutil.which("chromium") or "/usr/bin/chromium"
)
OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]


WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Launcher of Chromium; skips, with the reason, where there is none.

    For one module only: Playwright's event loop would disturb other tests.
    """
    missing = None
    if not Path(CHROMIUM).exists():
        missing = "no Chromium here: apt-get install chromium"
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing = "playwright is not installed: pip install '.[browser]'"
    if missing:
        if os.environ.get("RTASK_REQUIRE_BROWSER"):
            pytest.fail(missing)
        pytest.skip(missing)
    with sync_playwright() as playwright:
        yield playwright.chromium


@pytest.fixture(scope="module")
def browser(chromium: Any) -> Iterator[Any]:
    """Chromium, headless."""
    launched = chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
    yield launched
    launched.close()


@pytest.fixture(scope="module")
def browser_3d(chromium: Any) -> Iterator[Any]:
    """Chromium with WebGL, drawn by its software renderer."""
    options = [option for option in OPTIONS if option != "--disable-gpu"]
    launched = chromium.launch(executable_path=CHROMIUM, args=[*options, *WEBGL])
    yield launched
    launched.close()


@pytest.fixture(scope="module")
def browser_2d(chromium: Any) -> Iterator[Any]:
    """Chromium without WebGL."""
    launched = chromium.launch(executable_path=CHROMIUM, args=[*OPTIONS, "--disable-3d-apis"])
    yield launched
    launched.close()
