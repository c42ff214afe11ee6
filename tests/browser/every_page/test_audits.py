"""The audits of pages find what they are for: a rule that never hits would guard nothing."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import pytest

from tests.browser.every_page.audits import AUDITS

pytestmark = pytest.mark.browser

SOUND = """<!doctype html><title>t</title><main style="background: #fff; color: #222"><h1>h</h1>
<button aria-label="Stop query 7">Stop</button>
<p style="color: #767676">quiet</p><p style="font-size: 24px; color: #8a8a8a">large</p></main>"""
FAULTY = {
    "called otherwise than it reads": ("<button aria-label='Let 7 end'>Let end</button>", "Let 7"),
    "text outside of every landmark": ("<main>in</main><div>out</div>", "out"),
    "text too faint": ("<main style='background: #fff'><kbd style='color: #999'>Y</kbd></main>",
                       "2.85: Y"),
    "nameless": ("<main><button></button></main>", "<button></button>"),
    "heading without one above": ("<main><h1>a</h1><h3>b</h3></main>", "h3 b"),
    "empty head of a column": ("<table><tr><th></th><td>seven</td></tr></table>", "seven"),
}  # fmt: skip
"""A page that breaks each rule, and a part of what the rule says."""


def test_each_rule_is_broken_by_its_fault_and_by_nothing_sound(browser: Any) -> None:
    with closing(browser.new_page()) as page:
        for rule, (body, said) in FAULTY.items():
            page.set_content(SOUND)
            assert page.evaluate(AUDITS[rule]) == [], rule
            page.set_content(f"<!doctype html><title>t</title>{body}")
            found = page.evaluate(AUDITS[rule])
            assert len(found) == 1, rule
            assert said in found[0], rule
