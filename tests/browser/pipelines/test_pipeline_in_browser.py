"""The composer of pipelines in a real browser: by mouse, by keyboard, and without scripts."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import httpx
import pytest

from tests.browser.pages import EACH_LOOK, LOOKS, PHONE, fits, keep_picture, open_page
from tests.browser.pipelines.cutting import CLOUD, COMPOSED, SERVICE
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("pipelines")
    (folder / "cut.py").write_text(SERVICE, encoding="utf-8")
    with running_server(folder / "store", "--service", str(folder / "cut.py")) as running:
        yield running


def _pipeline(page: Any) -> Any:
    """Return the pipeline in the address; asked in the page, as ``page.url`` may come later."""
    (text,) = parse_qs(page.evaluate("() => location.search.slice(1)")).get("pipeline", ["{}"])
    return json.loads(text)


def _choices(page: Any, label: str) -> list[str]:
    options = page.locator("#step-weigh").get_by_label(label).locator("option")
    return [option.get_attribute("value") for option in options.all()]


def _add(page: Any, method: str, count: int) -> None:
    page.get_by_label("next step").select_option(method)
    page.get_by_role("button", name="Add the step").click()
    page.locator(".step").nth(count - 1).wait_for()


def _compose(page: Any, url: str) -> None:
    """Compose the pipeline; each change leads to an address that holds it."""
    page.goto(f"{url}/tools/pipeline")
    _add(page, "lab/Cut/cut", 1)
    page.locator("#step-cut summary").click()
    page.get_by_label("pieces", exact=True).fill("3")
    _add(page, "lab/Cut/weigh", 2)


@pytest.mark.parametrize("look", EACH_LOOK)
def test_steps_are_joined_where_their_types_fit_and_run(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        _compose(page, server.url)
        assert _choices(page, "cloud *, from") == [
            "",
            "$input.cloud",
            "$input.weigh_cloud",
            "cut.parts.0.cloud",
        ]
        assert _choices(page, "density *, from") == ["", "$input.density", "cut.height"]
        # A height in m is no angle in rad, so it is not offered for one.
        page.locator("#step-weigh summary").click()
        assert _choices(page, "turned, from") == ["", "$input.turned"]
        page.get_by_label("call it").select_option("cut.parts")
        page.locator('select option[value="item.cloud"]').wait_for(state="attached")
        page.get_by_label("density *", exact=True).fill("0.5")
        page.locator("#step-weigh").get_by_label("cloud *, from").select_option("item.cloud")
        page.wait_for_url("**item.cloud**")
        assert _pipeline(page) == COMPOSED
        page.get_by_label("cloud *", exact=True).set_input_files(
            {"name": "six.ply", "mimeType": "application/octet-stream", "buffer": CLOUD}
        )
        page.get_by_role("button", name="Run", exact=True).click()
        heading = page.get_by_role("heading", name="Answer of weigh: 3 calls")
        heading.wait_for()
        assert re.search(r"calls [\d.]+ m?s, \d+ Bytes$", heading.inner_text())
        assert re.search(r"[\d.]+ m?s, [\d.]+ (Bytes|kB)", page.locator(".board").text_content())
        assert page.locator("#step-weigh [data-answers] dd").all_inner_texts()[:1] == ["1"]
        assert "a cloud of 2 points" in page.locator("#step-cut [data-answers]").inner_text()
        page.locator("#step-cut [data-clouds] canvas").first.wait_for()
        assert page.locator(".board rect").count() == 3  # the step for each entry has two
        assert page.locator(".board path").count() == 1
        assert fits(page)
        keep_picture(page, f"pipeline-{look}")
        assert _pipeline(page) == COMPOSED
        # The file stays chosen: what was changed is run again at once.
        page.get_by_label("density *", exact=True).fill("1")
        page.get_by_role("button", name="Run", exact=True).click()
        page.locator("#step-weigh [data-answers] dd").first.get_by_text("2", exact=True).wait_for()
        page.go_back()
        page.wait_for_url(lambda url: "%22density%22%3A0.5" in url)
        page.locator('[name="s1.density"][value="0.5"]').wait_for()


def test_the_code_beside_it_is_the_call_that_programs_make(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        page.goto(f"{server.url}/tools/pipeline")
        page.get_by_text("As JSON", exact=True).click()
        page.get_by_label("The pipeline as JSON").fill(json.dumps(COMPOSED))
        page.get_by_role("button", name="Take this JSON").click()
        page.locator("#step-weigh").wait_for()
        code = page.locator("[data-language=JavaScript]").text_content()
    body = json.loads(code.partition("JSON.stringify(")[2].partition("),\n")[0])
    address = code.partition('fetch("')[2].partition('"')[0]
    sent = {**body, "inputs": {"cloud": CLOUD.decode()}}
    refused = httpx.post(address, json=sent, timeout=60)
    assert refused.status_code == 400
    assert "step cut: cloud" in refused.json()["detail"]
    sent["inputs"]["cloud"] = base64.b64encode(CLOUD).decode()
    answer = httpx.post(address, json=sent, timeout=60).json()
    assert [one["mass"] for one in answer["output"]["weigh"]] == [1.0, 1.0, 1.0]


CHAIN = ("rtask/Segmentation/segment", "rtask/Engine/search_object", "rtask/Engine/recall_grasps")
JOINED = {
    "search_object": ("data", "segment › objects › first › cloud"),
    "recall_grasps": ("object", "search_object › similar_objects › first › object"),
}
"""By step: the input that takes an output of the step before, as the list of outputs names it."""


def _by_mouse(page: Any, field: Any, words: str) -> None:
    field.select_option(label=words)


def _by_keys(page: Any, field: Any, words: str) -> None:
    """Go down a list from its top: typed words are forgotten after a second without a key."""
    labels = field.locator("option").all_inner_texts()
    field.focus()
    page.keyboard.press("Home")
    for _ in range(labels.index(words)):
        page.keyboard.press("ArrowDown")
    assert field.locator("option:checked").inner_text() == words


def _press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name).focus()
    page.keyboard.press("Enter")


def test_what_is_seen_recognised_and_grasped_is_composed_alike_by_mouse_and_by_keys(
    browser: Any, server: RunningServer
) -> None:
    composed = []
    for choose in (_by_mouse, _by_keys):
        with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
            page.goto(f"{server.url}/tools/pipeline")
            for number, method in enumerate(CHAIN, 1):
                choose(page, page.get_by_label("next step"), method)
                if choose is _by_mouse:
                    page.get_by_role("button", name="Add the step").click()
                else:
                    _press(page, "Add the step")
                page.locator(".step").nth(number - 1).wait_for()
            for step, (port, words) in JOINED.items():
                source = page.locator(f"#step-{step} select[name$='.{port}'][name^=from]")
                if not source.is_visible():  # inputs that may be left blank are folded away
                    summary = page.locator(f"#step-{step} summary").first
                    summary.focus()
                    page.keyboard.press("Enter")
                choose(page, source, words)
                path = words.replace("first", "0").replace(" › ", ".")
                page.wait_for_url(lambda url, path=path: path in url)
            composed.append(_pipeline(page))
    assert composed[0] == composed[1]
    inputs = {one["id"]: one["inputs"] for one in composed[0]["steps"]}
    assert inputs["search_object"]["data"] == {"$ref": "segment.objects.0.cloud"}
    assert inputs["recall_grasps"]["object"] == {"$ref": "search_object.similar_objects.0.object"}


def test_a_reply_that_comes_late_does_not_undo_what_was_chosen_since(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        _compose(page, server.url)
        held: list[Any] = []

        def hold_the_first(route: Any) -> None:
            if held or route.request.method != "POST":
                route.continue_()
            else:
                held.append(route)

        page.route("**/tools/pipeline*", hold_the_first)
        weigh = page.locator("#step-weigh")
        with page.expect_request(lambda sent: sent.method == "POST"):
            weigh.get_by_label("density *, from").select_option("cut.height")
        weigh.get_by_label("cloud *, from").select_option("$input.weigh_cloud")
        page.wait_for_function("() => location.search.includes('weigh_cloud')")
        both = {"cloud": {"$input": "weigh_cloud"}, "density": {"$ref": "cut.height"}}
        assert _pipeline(page)["steps"][1]["inputs"] == both
        (late,) = held
        late.fulfill(
            body="<div data-pipeline data-address='/tools/pipeline'><p id='old'></p></div>"
        )
        page.get_by_label("name of the step").first.fill("pieces")
        page.keyboard.press("Enter")
        page.locator("#step-pieces").wait_for()
        named = {"cloud": {"$input": "weigh_cloud"}, "density": {"$ref": "pieces.height"}}
        assert _pipeline(page)["steps"][1]["inputs"] == named


def test_keyboard_alone_composes_renames_and_removes(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url, **LOOKS["phone-dark"]) as page:
        _compose(page, server.url)
        page.get_by_label("name of the step").first.focus()
        page.keyboard.press("Control+a")
        page.keyboard.type("pieces")
        page.keyboard.press("Enter")
        page.locator("#step-pieces").wait_for()
        assert _pipeline(page)["steps"][1]["inputs"] == {"cloud": {"$ref": "pieces.parts.0.cloud"}}
        page.get_by_role("button", name="Remove pieces").focus()
        page.keyboard.press("Enter")
        page.locator("#step-pieces").wait_for(state="detached")
        assert _pipeline(page) == {"steps": [{"id": "weigh", "call": "lab/Cut/weigh",
                                              "inputs": {}}]}  # fmt: skip


def test_what_is_wrong_is_said_where_it_is(browser: Any, server: RunningServer) -> None:
    with open_page(
        browser, server.url, expected=("status of 4", "400 ", "422 "), **LOOKS["laptop-light"]
    ) as page:
        _compose(page, server.url)
        page.get_by_label("density *", exact=True).fill("-1")
        page.get_by_role("button", name="Run", exact=True).click()
        page.get_by_text("cloud: needed to run").wait_for()
        page.get_by_label("cloud *", exact=True).set_input_files(
            {"name": "six.ply", "mimeType": "application/octet-stream", "buffer": CLOUD}
        )
        page.get_by_role("button", name="Run", exact=True).click()
        said = page.locator("#step-weigh .problem")
        said.wait_for()
        assert said.inner_text() == "nothing weighs less than nothing"
        page.get_by_label("name of the step").last.fill("cut")
        page.get_by_role("button", name="Update").click()
        page.locator("#step-weigh").get_by_text("expected a name of its own").wait_for()
        page.get_by_text("As JSON", exact=True).click()
        page.get_by_label("The pipeline as JSON").fill('{"steps": [')
        page.get_by_role("button", name="Take this JSON").click()
        page.get_by_text("not JSON that can be read").wait_for()


def _smoothed(name: str, path: str) -> dict[str, Any]:
    inputs = {"manipulator": "arm", "path": {"$ref": path}}
    return {"id": name, "call": "example/Trajopt/smooth", "inputs": inputs}


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        (
            [_smoothed("a", "b.path"), _smoothed("b", "a.path")],
            "these steps wait for each other: a, b",
        ),
        ([COMPOSED["steps"][0], _smoothed("way", "cut.parts.0.cloud")], "does not fit"),
    ],
    ids=["circle", "misfit"],
)
def test_what_cannot_be_joined_is_refused_with_the_reason(
    browser: Any, server: RunningServer, steps: list[dict[str, Any]], words: str
) -> None:
    with open_page(browser, server.url, expected=("status of 4", "400 ", "422 ")) as page:
        page.goto(
            f"{server.url}/tools/pipeline?{urlencode({'pipeline': json.dumps({'steps': steps})})}"
        )
        files = page.locator("input[type=file]")
        if files.count():
            file = {"name": "six.ply", "mimeType": "application/octet-stream", "buffer": CLOUD}
            files.first.set_input_files(file)
        page.get_by_role("button", name="Run", exact=True).click()
        page.locator(".problem").get_by_text(words).first.wait_for()


def test_without_scripts_the_form_adds_removes_and_runs(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, java_script_enabled=False, viewport=PHONE) as page:
        _compose(page, server.url)
        page.get_by_label("call it").select_option("cut.parts")
        page.get_by_role("button", name="Update").click()
        # Only the next page has this choice.
        page.locator("#step-weigh").get_by_label("cloud *, from").select_option("item.cloud")
        page.get_by_label("density *", exact=True).fill("0.5")
        page.get_by_label("cloud *", exact=True).set_input_files(
            {"name": "six.ply", "mimeType": "application/octet-stream", "buffer": CLOUD}
        )
        page.get_by_role("button", name="Run", exact=True).click()
        assert page.locator("#step-weigh [data-answers] dd").first.inner_text() == "1"
        page.get_by_role("button", name="Remove weigh").click()
        page.locator("#step-weigh").wait_for(state="detached")
        page.locator("#step-cut").wait_for()
        assert [step["id"] for step in _pipeline(page)["steps"]] == ["cut"]
        assert fits(page)


def test_the_twin_holds_the_pipeline_and_what_fits(server: RunningServer) -> None:
    text = json.dumps(COMPOSED)
    twin = httpx.get(f"{server.url}/tools/pipeline.json", params={"pipeline": text}).json()
    ports = {port["field"]: port["offered"] for port in twin["steps"][1]["ports"]}
    assert ports == {
        "cloud": ["item.cloud", "cut.parts.0.cloud"],
        "density": ["cut.height"],
        "turned": [],
    }
    refused = httpx.get(f"{server.url}/tools/pipeline.json", params={"pipeline": "{"})
    assert refused.status_code == 400
    unknown = {"steps": [{"id": "a", "call": "lab/Cut/cutt"}]}
    refused = httpx.get(
        f"{server.url}/tools/pipeline.json", params={"pipeline": json.dumps(unknown)}
    )
    assert "has no method 'cutt'" in refused.json()["detail"]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ("cut", "step a: call 'cut'; expected <namespace>/<name>/<method>"),
        ("lab/Cup/cut", "step a: no service lab/Cup"),
    ],
)
def test_an_unknown_call_is_said_with_its_step(
    server: RunningServer, call: str, words: str
) -> None:
    asked = {"pipeline": json.dumps({"steps": [{"id": "a", "call": call}]})}
    refused = httpx.get(f"{server.url}/tools/pipeline.json", params=asked)
    assert 400 <= refused.status_code < 500
    assert words in refused.json()["detail"]


@pytest.mark.parametrize("do", ["json", "change", "run", "save"])
def test_a_name_that_is_no_unicode_text_is_refused_in_words(server: RunningServer, do: str) -> None:
    text = '{"steps":[{"id":"\\ud800","call":"lab/Cut/cut"}]}'  # half of a surrogate pair
    form, html = {"do": do, "pipeline": text, "json": text}, {"Accept": "text/html"}
    refused = httpx.post(f"{server.url}/tools/pipeline", data=form, headers=html)
    assert refused.status_code == 400
    assert "not JSON that can be read" in refused.text


@pytest.mark.parametrize("do", ["run", "save"])
def test_without_a_step_there_is_nothing_to_run_or_keep(server: RunningServer, do: str) -> None:
    form, html = {"do": do, "save_as": "lab/None"}, {"Accept": "text/html"}
    refused = httpx.post(f"{server.url}/tools/pipeline", data=form, headers=html)
    assert refused.status_code == 400
    assert "add a step first" in refused.text


def test_a_pipeline_that_no_address_can_hold_is_refused_in_words(server: RunningServer) -> None:
    step = {
        "id": "a",
        "call": "example/Grasping/plan",
        "inputs": {"polygon": [[0.123456, 1]] * 3000},
    }
    form = {"do": "change", "pipeline": json.dumps({"steps": [step]})}
    html = {"Accept": "text/html"}
    refused = httpx.post(f"{server.url}/tools/pipeline", data=form, headers=html, timeout=60)
    assert refused.status_code == 400
    assert "too long for an address" in refused.text


@pytest.mark.parametrize("scripts", [True, False], ids=["scripts", "no-scripts"])
def test_a_pipeline_is_kept_as_a_service_and_called_over_http(
    browser: Any, server: RunningServer, scripts: bool
) -> None:
    name = f"lab/Weights{scripts}"
    with open_page(
        browser, server.url, expected=("status of 4", "400 "), java_script_enabled=scripts
    ) as page:
        page.goto(f"{server.url}/tools/pipeline?{urlencode({'pipeline': json.dumps(COMPOSED)})}")
        page.get_by_text("Keep it as a service").click()
        page.get_by_role("button", name="Keep it").click()
        page.get_by_text("to keep it, it needs a name").wait_for()
        page.get_by_label("name of the service").fill(name)
        page.get_by_role("button", name="Keep it").click()
        page.wait_for_url(f"**/services/{name}@1.0.0")
        page.get_by_label("cloud *").wait_for()
    sent = {"cloud": base64.b64encode(CLOUD).decode()}
    answer = httpx.post(f"{server.url}/services/{name}/run", json=sent, timeout=60).json()
    assert [one["mass"] for one in answer["weigh"]] == [1.0, 1.0, 1.0]


def _slow(seconds: float) -> str:
    """Return the query of a page with two steps, the second of which takes its time."""
    steps = [
        {"id": "first", "call": "lab/Cut/dry", "inputs": {"seconds": 0}},
        {"id": "second", "call": "lab/Cut/dry", "inputs": {"seconds": seconds}},
    ]
    return urlencode({"pipeline": json.dumps({"steps": steps})})


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_long_run_tells_how_far_it_is_and_is_cancelled(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        page.goto(f"{server.url}/tools/pipeline?{_slow(600)}")
        page.get_by_role("button", name="Run", exact=True).press("Enter")
        page.get_by_text("1 of 2 steps").wait_for()
        assert page.locator("progress").evaluate("one => one.value") == 0.5
        assert page.get_by_role("button", name="Run", exact=True).is_disabled()
        assert fits(page)
        keep_picture(page, f"pipeline-running-{look}")
        page.wait_for_url("**&job=**")
        page.reload()  # the address holds the run
        page.get_by_text("1 of 2 steps").wait_for()
        page.get_by_role("button", name="Cancel").press("Enter")
        page.get_by_role("alert").get_by_text("the call was cancelled").wait_for()
        assert page.get_by_role("button", name="Run", exact=True).is_enabled()


@pytest.mark.parametrize("scripts", [True, False], ids=["scripts", "no-scripts"])
def test_a_long_run_ends_with_its_answers(
    browser: Any, server: RunningServer, scripts: bool
) -> None:
    with open_page(browser, server.url, java_script_enabled=scripts) as page:
        page.goto(f"{server.url}/tools/pipeline?{_slow(4)}")
        page.get_by_role("button", name="Run", exact=True).click()
        page.get_by_role("heading", name="Answer of second").wait_for()
        assert page.locator("[data-answers]").count() == 2
        assert parse_qs(urlsplit(page.url).query).keys() == {"pipeline", "job"}
        address = page.url.replace("/tools/pipeline?", "/tools/pipeline.json?")
    twin = httpx.get(address, timeout=60).json()
    assert twin["job"]["state"] == "succeeded"
    assert twin["results"]["second"]["took_ms"] >= 4000
    assert twin["results"]["second"]["size"] > 0


def test_a_run_of_another_pipeline_is_not_shown_for_this_one(server: RunningServer) -> None:
    address = f"{server.url}/tools/pipeline.json?{_slow(0)}&job=unknown"
    shown = httpx.get(address, timeout=60).json()
    assert "no longer kept" in shown["problem"]["detail"]
    assert not shown["ran"]
