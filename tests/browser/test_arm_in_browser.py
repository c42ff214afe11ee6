"""The page of arms and paths in a real browser, over the services that know the kinematics."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlencode

import httpx
import pytest

from tests.browser.pages import EACH_LOOK, LOOKS, TIMEOUT_MS, fits, keep_picture, open_page
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PLANAR = {
    "robot": "robots/PlanarArm", "arm": "arm", "start": "-2,0,0", "goal": "2,0,0",
    "balls": "0.7,0,0,0.1", "camera": "-1.571,1.571",
}  # fmt: skip
ROBOTS = ("PlanarArm", "Point", "Panda", "NAO")


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


def _open(page: Any, server: RunningServer, **state: str) -> None:
    page.goto(f"{server.url}/tools/arm#{urlencode({**PLANAR, **state})}")
    page.locator(".link.goal").first.wait_for()


def _asked(server: RunningServer, method: str, **request: Any) -> Any:
    body = {"manipulator": "arm", **request, "$data": {"robot": "robots/PlanarArm"}}
    return httpx.post(f"{server.url}/services/example/{method}", json=body, timeout=60).json()


def _pose(page: Any) -> list[float]:
    fields = page.locator("[data-pose] input").all()
    return [float(field.input_value()) for field in fields]


def _wait_for_pose(page: Any, axis: int, value: float) -> None:
    """Wait until a number of the hand's pose is shown, m or degrees; shown are four digits."""
    field = page.locator("[data-pose] input").nth(axis)
    page.wait_for_function(
        "([field, value]) => Math.abs(Number(field.value) - value) < 0.002",
        arg=[field.element_handle(), value],
    )


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_path_leads_around_a_ball_is_played_and_smoothed(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        _open(page, server)
        page.get_by_role("button", name="Plan", exact=True).click()
        page.locator(".path").wait_for(state="attached")
        ball = [0.7, 0.0, 0.0, 0.1]
        planned = _asked(server, "Trajopt/plan", start=[-2, 0, 0], goal=[2, 0, 0], obstacles=[ball])
        row = page.locator("[data-paths] tr").first
        assert row.locator("td").first.inner_text() == str(len(planned["path"]))
        near = min(
            one["clearance"]
            for one in _asked(server, "Trajopt/trace", path=planned["path"], obstacles=[ball])[
                "postures"
            ]
        )
        assert near > 0
        assert row.locator("td").nth(2).inner_text() == f"{100 * near:.1f} cm"
        page.get_by_role("button", name="Play").wait_for()  # it was played to its end
        assert page.locator("[data-player] [name=at]").input_value() == "59"
        page.get_by_role("button", name="Smooth").click()
        page.locator("[data-paths] tr").nth(1).wait_for()
        lengths = page.locator("[data-paths] td:nth-child(3)").all_inner_texts()
        assert float(lengths[1]) <= float(lengths[0])
        assert page.locator("[data-clearance] .curve").count() == 2
        assert fits(page)
        keep_picture(page, f"arm-{look}")
        page.get_by_label("ball 1, radius in m").fill("0.2")
        page.get_by_label("ball 1, radius in m").press("Tab")
        # Both paths were planned for another scene.
        page.locator("[data-results]").wait_for(state="hidden")
        assert page.locator(".path").count() == 0


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robot_is_drawn_with_its_joints_and_planned_for(
    browser: Any, server: RunningServer, robot: str
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        page.goto(f"{server.url}/tools/arm")
        page.locator(".link.goal").first.wait_for()
        page.locator("[data-robot]").select_option(f"robots/{robot}")
        body = {"$data": {"robot": f"robots/{robot}"}}
        address = f"{server.url}/services/example/Kinematics/describe"
        arm = httpx.post(address, json=body, timeout=60).json()["manipulators"][0]
        page.get_by_label(f"{arm['joints'][-1]}, rad or m").wait_for()
        page.locator(".link.goal").first.wait_for(state="attached")
        page.get_by_role("button", name="Plan", exact=True).click()
        page.locator(".path").wait_for(state="attached")
        has_count(page.locator("[data-joint][type=range]"), len(arm["joints"]))


def test_a_pose_that_is_typed_and_one_that_is_dragged_lead_to_the_same_posture(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        _open(page, server, start="0.3,0.6,0.4", balls="")
        _wait_for_pose(page, 5, 1.3 * 180 / 3.141592653589793)
        at = page.locator('[data-drag-pose="move"]').bounding_box()
        x, y = at["x"] + at["width"] / 2, at["y"] + at["height"] / 2
        before = _pose(page)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 30, y + 20, steps=5)
        page.mouse.up()
        page.wait_for_function(
            "x => Number(document.querySelector('[data-pose] input').value) < x - 0.01",
            arg=before[0],
        )
        page.locator("[data-drawing][aria-busy=false]").wait_for()
        dragged = _pose(page)
        assert dragged[1] < before[1]
        assert dragged[5] == pytest.approx(before[5], abs=1.0)  # within the 0.01 rad of the service
        _open(page, server, start="0.3,0.6,0.4", balls="", camera="-1.571,1.57")
        for field, value in zip(page.locator("[data-pose] input").all(), dragged, strict=True):
            field.fill(str(value))
        page.get_by_role("button", name="Move the hand there").click()
        page.get_by_label("joint1, rad or m").wait_for()
        page.wait_for_function(
            "() => Number(document.querySelector('[data-joint][type=number]').value) !== 0.3"
        )
        page.locator("[data-drawing][aria-busy=false]").wait_for()
        joints = [
            float(field.input_value()) for field in page.locator("[data-joint][type=number]").all()
        ]
        reached = _asked(server, "Kinematics/forwardKinematics", joints=joints)["pose"]["position"]
        # The service is within 1 mm, and joints are shown with four digits.
        assert [reached["x"], reached["y"]] == pytest.approx(dragged[:2], abs=2e-3)


def test_a_pose_out_of_reach_shows_how_far_the_hand_comes(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        _open(page, server, start="0.3,0.6,0.4", balls="")
        for axis, value in enumerate((2.0, 0.0, 0.0, 0.0, 0.0, 0.0)):
            page.locator("[data-pose] input").nth(axis).fill(str(value))
        page.get_by_role("button", name="Move the hand there").press("Enter")
        said = page.get_by_text("Out of reach: the hand stops")
        said.wait_for()
        # The arm is 1.1 m long; the best posture weighs distance against orientation.
        assert 90.0 <= float(said.inner_text().split()[6]) <= 120.0
        assert page.locator(".residual").count() == 1


def test_a_goal_inside_a_ball_is_refused_with_its_reason(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, expected=("422",), **LOOKS["laptop-light"]) as page:
        _open(page, server, goal="0,0,0", balls="0.7,0,0,0.1")
        page.locator(".link.hit").first.wait_for()
        page.get_by_role("button", name="Plan", exact=True).press("Enter")
        page.get_by_role("alert").get_by_text("goal: the robot touches an obstacle").wait_for()
        has_count(page.locator(".path"), 0)


def test_the_view_and_the_scene_are_changed_by_keys_and_kept_in_the_address(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["laptop-light"]) as page:
        _open(page, server)
        page.get_by_role("button", name="Add a ball").press("Enter")
        page.get_by_label("ball 2, x in m").fill("-0.5")
        page.get_by_label("ball 2, x in m").press("Tab")
        page.get_by_label("joint2, rad or m").fill("0.5")
        page.locator("[data-drawing]").focus()
        page.keyboard.press("ArrowDown")
        page.wait_for_url(lambda url: "-0.5" in url and "-2%2C0.5%2C0" in url and "1.44" in url)
        page.reload()
        page.locator(".link.goal").first.wait_for()
        assert page.get_by_label("ball 2, x in m").input_value() == "-0.5"
        assert page.get_by_label("joint2, rad or m").input_value() == "0.5"
        page.get_by_role("button", name="Remove ball 1").press("Enter")
        has_count(page.locator("[data-balls] tr"), 1)


def test_the_browser_computes_no_kinematics(browser: Any) -> None:
    with (
        running_server(None) as server,
        open_page(
            browser, server.url, expected=("ERR_", "Failed"), **LOOKS["laptop-light"]
        ) as page,
    ):
        _open(page, server)
        page.locator("[data-drawing][aria-busy=false]").wait_for()
        place = "() => document.querySelector('.link.start').getAttribute('x2')"
        before = page.evaluate(place)
        server.stop(signal.SIGKILL)
        page.get_by_label("joint1, rad or m").fill("1.0")
        page.get_by_role("alert").get_by_text("No answer from the server since").wait_for(
            timeout=TIMEOUT_MS
        )
        assert page.evaluate(place) == before
