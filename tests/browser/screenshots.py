"""Screenshots for the documentation: ``python -m tests.browser.screenshots STORE [PICTURE ...]``.

STORE is a folder that a demo left, ``rtask-demo/store``; it is copied, not changed. Without a
PICTURE all are taken. That of the live page comes from another demo, which is stopped then.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from urllib.parse import urlencode

import httpx
from playwright.sync_api import Page, sync_playwright

from tests.browser.conftest import CHROMIUM, OPTIONS, WEBGL
from tests.browser.pages import LAPTOP, PHONE
from tests.servers import running_server

IMAGES = Path(__file__).parents[2] / "docs" / "images"
_ARM = {"data": {"robot": "robots/PlanarArm"}}
_PIPELINE = {
    "steps": [
        {**_ARM, "id": "hand", "call": "example/Kinematics/forwardKinematics",
         "inputs": {"manipulator": "arm", "joints": [0.4, 0.9, -0.6]}},
        {**_ARM, "id": "postures", "call": "example/Kinematics/inverseKinematics",
         "inputs": {"manipulator": "arm", "pose": {"$ref": "hand.pose"}}},
        {**_ARM, "id": "way", "call": "example/Trajopt/plan",
         "inputs": {"manipulator": "arm", "start": [-2, 0, 0],
                    "goal": {"$ref": "postures.solutions.0"}, "obstacles": [[0.7, 0, 0, 0.1]]}},
        {**_ARM, "id": "links", "call": "example/Kinematics/linkPoses",
         "inputs": {"manipulator": "arm", "joints": {"$ref": "item"}},
         "each": {"$ref": "way.path"}},
    ]
}  # fmt: skip
"""Where a hand is, another posture that puts it there, the way to that, the links on the way."""
_LIVE = "page-activity"
_COMPOSED = f"/tools/pipeline?{urlencode({'pipeline': json.dumps(_PIPELINE)})}"
_FAULTY = """PREFIX rt: <https://w3id.org/rtask-kg/ns#>
SELECT ?object ?name {
  ?object a rt:ManipulableObject ;
    rt:nmae ?name
}"""
_EDITED = f"/sparql?{urlencode({'query': _FAULTY})}"
_PROOF = "/explain?s={object}&p=rdf:type&o="
_SHOWN = {
    "page-editor": (_EDITED, {**LAPTOP, "height": 640}, "light"),
    "page-editor-phone": (_EDITED, PHONE, "dark"),
    "page-proof-holds": (f"{_PROOF}sumo:Physical", {**LAPTOP, "height": 520}, "light"),
    "page-proof-fails": (f"{_PROOF}rt:GraspAttempt", {**LAPTOP, "height": 520}, "light"),
    "page-proof-undecided": (
        f"{_PROOF}sumo:Physical&budget=1",
        {**LAPTOP, "height": 520},
        "light",
    ),
    "page-object": ("/object?iri={object}#grasp=1", {**LAPTOP, "height": 900}, "light"),
    "page-outcomes-phone": ("/feedback", PHONE, "dark"),
    "page-object-phone": ("/object?iri={object}#grasp=1", PHONE, "dark"),
    "page-arm": ("/tools/arm", LAPTOP, "light"),
    "page-robot": ("/robot?iri={robot}", LAPTOP, "light"),
    "page-pipeline": (_COMPOSED, LAPTOP, "light"),
}


def _take(page: Page, path: Path) -> None:
    """Save what the window shows, once nothing is loading."""
    page.wait_for_load_state("networkidle")
    page.wait_for_function("() => [...document.images].every((i) => i.complete || i.loading)")
    # A cloud is drawn before it is painted.
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 500)))")
    page.screenshot(path=str(path))


def _plan_for_panda(page: Page) -> None:
    """Show the path of an arm around a ball, half way."""
    page.locator(".link.goal").first.wait_for()
    page.locator("[data-robot]").select_option("robots/Panda")
    page.get_by_label("panda_joint7, rad or m").wait_for()
    page.get_by_role("button", name="Plan", exact=True).click()
    page.get_by_role("button", name="Play").wait_for()
    page.locator("[data-player] [name=at]").fill("30")
    page.locator("[data-robot]").scroll_into_view_if_needed()


def _watch_demo(page: Page) -> None:
    """Picture the live page while a demo runs: two robots with an outcome each."""
    page.set_default_timeout(600_000)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "rtask", "demo", "--data", f"{folder}/demo"]
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as demo:
            try:
                assert demo.stderr is not None
                address = next(line.split()[-1] for line in demo.stderr if "/activity" in line)
                page.goto(address)
                page.get_by_role("img", name="The last attempt").nth(1).wait_for()
                page.screenshot(path=str(IMAGES / f"{_LIVE}.png"))  # its events never end
            finally:
                demo.terminate()
                demo.communicate()


def main() -> None:
    """Take every screenshot at its size and in its theme."""
    store, wanted = Path(sys.argv[1]), sys.argv[2:] or [*_SHOWN, _LIVE]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "store"
        shutil.copytree(store, copy)
        with running_server(copy) as server, sync_playwright() as playwright:
            objects = httpx.get(f"{server.url}/objects.json", timeout=60).json()["objects"]
            robots = httpx.get(f"{server.url}/robots.json", timeout=60).json()["robots"]
            known = {
                "object": objects[0]["object"] if objects else "",
                "robot": robots[0]["robot"] if robots else "",
            }
            options = [option for option in OPTIONS if option != "--disable-gpu"]
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*options, *WEBGL])
            for name in (one for one in wanted if one in _SHOWN):
                address, size, theme = _SHOWN[name]
                context = browser.new_context(
                    viewport=size,  # type: ignore[arg-type]  # playwright's own type of a size
                    color_scheme=theme,  # type: ignore[arg-type]
                    locale="en",
                    device_scale_factor=1,
                )
                page = context.new_page()
                page.goto(server.url + address.format(**known))
                if "object" in name:
                    page.locator("[data-place][data-drawn]").wait_for()
                    if size == PHONE:
                        page.locator("[data-cloud]").scroll_into_view_if_needed()
                if "arm" in name:
                    _plan_for_panda(page)
                if "editor" in name:
                    page.locator('sparql-editor[data-findings="1"]').wait_for()
                    page.locator(".cm-lintRange-error").scroll_into_view_if_needed()
                    page.locator(".cm-lintRange-error").hover()
                    page.locator(".cm-tooltip .cm-diagnostic").wait_for()
                if "pipeline" in name:
                    page.get_by_role("button", name="Run", exact=True).click()
                    page.locator("#step-links [data-answers]").wait_for()
                    page.mouse.move(0, 0)
                    page.locator(".board").scroll_into_view_if_needed()
                _take(page, IMAGES / f"{name}.png")
                context.close()
            if _LIVE in wanted:
                _watch_demo(browser.new_page(viewport=LAPTOP, color_scheme="light", locale="en"))
            browser.close()


if __name__ == "__main__":
    main()
