"""Latency of pages: events on /activity, a robot on /robots, pictures while judging outcomes.

::

    python -m tests.benchmarks.endpoint.bench_pages [--events 60] [--visits 20] [--attempts 20]

Headless Chromium on the same machine. Events are commits, one at a time; the row is there when it
is in the page's tree, beside which the same event is read from the raw stream by a plain client.
Judging is by keys: from the key press until the pictures of the next attempt are decoded and
painted, and from the sending of a verdict (10 s after the key, so that it can be taken back) until
the server has stored it. A robot connects and leaves in turn: from the beginning of the handshake,
or from the call that closes the connection, until its row says so.
"""

from __future__ import annotations

import argparse
import os
import random
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from endpoint.access.tokens import TokenStore
from tests.browser.attempts import store_of_attempts
from tests.browser.conftest import CHROMIUM, OPTIONS
from tests.browser.robots import robot
from tests.servers import RunningServer, bearer, running_server

_SEED = 5
_ROWS = """() => {
  window.seen = [];
  const list = document.querySelector("[data-events]");
  new MutationObserver(() => {
    const now = Date.now();
    for (const row of list.children) {
      const name = row.textContent.match(/bench-\\d+/)?.[0];
      if (name && !window.seen.some((one) => one[0] === name)) window.seen.push([name, now]);
    }
  }).observe(list, { childList: true, subtree: true });
}"""
_KEYS = """() => {
  window.painted = [];
  addEventListener("keydown", () => {
    const pressed = performance.now();
    requestAnimationFrame(() => requestAnimationFrame(async () => {
      const card = document.querySelector("[data-attempt]:not(.off)");
      await Promise.all([...card.querySelectorAll(".shots img")].map((one) => one.decode()));
      window.painted.push(performance.now() - pressed);
    }));
  }, true);
}"""
_PRESENT = """() => {
  window.present = [];
  const note = () => {
    const cells = [...document.querySelectorAll("[data-label='Last seen']")];
    const now = cells.some((one) => one.textContent === "connected");
    if (window.present.at(-1)?.[0] !== now) window.present.push([now, Date.now()]);
  };
  note();
  const part = document.querySelector("[data-follow]");
  new MutationObserver(note).observe(part, { childList: true, subtree: true });
}"""
_SENT = """() => performance.getEntriesByType("resource")
  .filter((one) => one.name.endsWith("/feedback") && one.initiatorType === "fetch")
  .map((one) => one.duration)"""


def _figures(name: str, values_ms: list[float]) -> None:
    median, high = np.percentile(values_ms, (50, 95))
    print(f"{name}: median {median:.0f} ms, p95 {high:.0f} ms, worst {max(values_ms):.0f} ms "
          f"({len(values_ms)})")  # fmt: skip


def _listen(server: RunningServer, headers: dict[str, str], arrived: dict[str, float]) -> None:
    """Note when each event is in the raw stream, ms since the epoch."""
    address = f"{server.url}/activity/events"
    with httpx.stream("GET", address, headers=headers, timeout=None) as stream:
        for line in stream.iter_lines():
            now = 1000 * time.time()
            start = line.find("bench-")
            if start >= 0:
                name = line[start : start + len("bench-000")]
                arrived.setdefault(name, now)
            if "bench-end" in line:
                return


def _events(page: Any, server: RunningServer, token: str, count: int) -> None:
    headers = bearer(token)
    arrived: dict[str, float] = {}
    listener = threading.Thread(target=_listen, args=(server, headers, arrived), daemon=True)
    listener.start()
    page.goto(f"{server.url}/activity")
    page.get_by_text("live", exact=True).wait_for()
    page.evaluate(_ROWS)
    draw = random.Random(_SEED)
    committed: dict[str, float] = {}
    with httpx.Client(base_url=server.url, headers=headers, timeout=60) as client:
        for number in range(count):
            name = f"bench-{number:03d}"
            committed[name] = 1000 * time.time()
            client.post("/engine/register_robot", json=_robot(name)).raise_for_status()
            time.sleep(draw.uniform(0.2, 0.8))
        page.wait_for_function("count => window.seen.length >= count", arg=count)
        client.post("/engine/register_robot", json=_robot("bench-end")).raise_for_status()
    listener.join(30)
    seen = dict(page.evaluate("() => window.seen"))
    raw = [arrived[name] - committed[name] for name in committed]
    row = [seen[name] - committed[name] for name in committed]
    _figures("request sent to event in the raw stream", raw)
    _figures("request sent to row on /activity", row)
    ratios = np.percentile(row, (50, 95)) / np.percentile(raw, (50, 95))
    print(f"ratio of the medians {ratios[0]:.1f}, of the 95th percentiles {ratios[1]:.1f}")


def _robots(page: Any, server: RunningServer, token: str, count: int) -> None:
    page.goto(f"{server.url}/robots")
    page.get_by_role("row").filter(has_text="nao-1").wait_for()
    page.wait_for_load_state("load")
    page.evaluate(_PRESENT)
    asked: list[float] = []
    seen = "count => window.present.length > count"
    draw = random.Random(_SEED)
    for _ in range(count):
        time.sleep(draw.uniform(0.2, 0.8))
        asked.append(1000 * time.time())
        with robot(server, token):
            page.wait_for_function(seen, arg=len(asked))
            time.sleep(draw.uniform(0.2, 0.8))
            asked.append(1000 * time.time())
        page.wait_for_function(seen, arg=len(asked))
    shown = [at for _, at in page.evaluate("() => window.present")[1:]]
    late = [at - begin for at, begin in zip(shown, asked, strict=True)]
    _figures("a robot connects to its row on /robots", late[::2])
    _figures("a robot leaves to its row on /robots", late[1::2])


def _robot(name: str) -> dict[str, Any]:
    hand = {"name": "hand", "gripper_type": "pinch", "max_opening": 0.08, "max_payload": 0.5}
    return {"name": name, "model": name, "end_effectors": [hand]}


def _judging(page: Any, server: RunningServer, token: str, count: int) -> None:
    page.goto(f"{server.url}/feedback")
    page.locator("[data-attempt]:not(.off) .judging").wait_for()
    page.evaluate(_KEYS)
    for number in range(count):
        page.keyboard.press("y")
        page.wait_for_function("count => window.painted.length >= count", arg=number + 1)
    _figures("key to the next attempt's pictures", page.evaluate("() => window.painted"))
    sent = "count => document.querySelectorAll('.attempt-list .sent').length >= count"
    page.wait_for_function(sent, arg=count)
    _figures("verdict sent to stored", page.evaluate(_SENT))
    found = httpx.get(f"{server.url}/feedback.json", headers=bearer(token), timeout=60).json()
    stored = sum(bool(one["verdicts"]) for one in found["attempts"])
    print(f"verdicts stored: {stored} of {count}")


def _signed_in(browser: Any, server: RunningServer, token: str) -> Any:
    page = browser.new_context(locale="en").new_page()
    page.set_default_timeout(60_000)
    page.goto(f"{server.url}/login?next=/")
    page.get_by_label("Access token").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url(f"{server.url}/")
    return page


def main() -> None:
    """Measure both and print medians and 95th percentiles."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--events", type=int, default=60)
    parser.add_argument("--visits", type=int, default=20)
    parser.add_argument("--attempts", type=int, default=20)
    asked = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        store = Path(folder) / "store"
        teacher, _ = store_of_attempts(store, asked.attempts + 2)
        with closing(TokenStore(store)) as tokens:
            admin, _ = tokens.create("admin")
            nao, _ = tokens.create("robot", agent="nao-1")
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        with running_server(store) as server:
            _events(_signed_in(browser, server, admin), server, admin, asked.events)
            _robots(_signed_in(browser, server, admin), server, nao, asked.visits)
            _judging(_signed_in(browser, server, teacher), server, teacher, asked.attempts)
        browser.close()
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
