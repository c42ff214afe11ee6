"""Pages opened in the browser that note whatever a person would call broken."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

PHONE = {"width": 360, "height": 740}
LAPTOP = {"width": 1280, "height": 800}
SIZES = {"phone": PHONE, "laptop": LAPTOP}
_THEMES = ("light", "dark")
ALL_LOOKS = {
    **{f"phone-{theme}": {"viewport": PHONE, "color_scheme": theme, "has_touch": True}
       for theme in _THEMES},
    **{f"laptop-{theme}": {"viewport": LAPTOP, "color_scheme": theme} for theme in _THEMES},
}  # fmt: skip
LOOKS = {name: ALL_LOOKS[name] for name in ("phone-dark", "laptop-light")}
"""Both sizes and both themes, in two runs instead of four."""
EACH_LOOK = ("phone-dark", pytest.param("laptop-light", marks=pytest.mark.deep))
"""Parameters of tests of behaviour; that pages fit both is tested for all of them in one place."""
TIMEOUT_MS = 60_000


@contextmanager
def open_page(
    browser: Any, url: str, token: str = "", expected: tuple[str, ...] = (), **options: Any
) -> Iterator[Any]:
    """Open a fresh page of a server; at the end, fail on faults.

    Faults are requests to other hosts, errors in the console, exceptions, violations of the
    content policy and answers of 400 and more.

    Parameters
    ----------
    url
        The server.
    token
        Of the person who signs in first; none stays a stranger.
    expected
        Parts of faults that the test causes on purpose.
    **options
        Of the browser's context.
    """
    faults: list[str] = []
    host = urlsplit(url).netloc
    context = browser.new_context(locale="en-GB", reduced_motion="reduce", **options)
    if options.get("java_script_enabled", True):
        context.add_init_script(
            "addEventListener('securitypolicyviolation', "
            "event => console.error('policy violated: ' + event.violatedDirective))"
        )
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.on("pageerror", lambda error: faults.append(f"page error: {error}"))
    page.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    page.on("response", lambda r: faults.append(f"{r.status} {r.url}") if r.status >= 400 else None)
    page.on("request", lambda asked: _note_foreign(asked.url, host, faults))
    if token:
        page.goto(f"{url}/login?next=/")
        page.get_by_label("Access token").fill(token)
        page.get_by_role("button", name="Sign in").click()
        page.wait_for_url(f"{url}/")
    yield page
    unexpected = [f for f in faults if not any(part in f for part in expected)]
    context.close()
    assert unexpected == [], "\n".join(unexpected)


def _note_foreign(url: str, host: str, faults: list[str]) -> None:
    if urlsplit(url).netloc not in (host, "") and not url.startswith(("data:", "blob:")):
        faults.append(f"asked another host: {url}")


def fits(page: Any) -> bool:
    """Tell whether nothing scrolls sideways, and whether there is one heading of level 1.

    Waits for the page to be loaded: a heading can be found, and measured, before the style sheet
    is there, when a long line of a program still makes the page wider.
    """
    page.wait_for_load_state("load")
    width = page.evaluate("() => document.documentElement.scrollWidth - innerWidth")
    return bool(width <= 0 and page.locator("h1").count() == 1)


def keep_picture(page: Any, name: str, *, full_page: bool = True) -> None:
    """Keep a screenshot in the folder that ``RTASK_SCREENSHOTS`` names, if it does."""
    folder = os.environ.get("RTASK_SCREENSHOTS")
    if folder:
        page.screenshot(path=str(Path(folder) / f"{name}.png"), full_page=full_page)
