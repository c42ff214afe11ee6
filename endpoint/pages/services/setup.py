"""Set-up of a robot with its sensor and gripper by a person (Kehoe 2014, 5.1, Scenario 3)."""

from __future__ import annotations

import re
from typing import Any

import flask
from werkzeug.datastructures import MultiDict

from endpoint.access.auth import SCOPES, Caller, require_scope
from endpoint.http.messages import RefusedError
from endpoint.http.problems import details_of
from endpoint.pages.operations import read_request
from endpoint.pages.render import Model, blueprint, context, current_request
from endpoint.pages.services.camera_info import CAMERA_INFO, read_camera_info
from endpoint.pages.services.datasets import readable_datasets
from endpoint.pages.services.tools import KINEMATICS, ROBOTS, service_named
from endpoint.pages.signin import require_form
from rtask.engine.operations.robots import RegisterRobot
from rtask.errors import MissingExtraError, RtaskError, UsageError
from rtask.extras import install_command
from rtask.wire.forms import controls_of

__all__: list[str] = []

_ADDRESS = "/setup"
_OPERATION = "register_robot"
_MODEL = "model"
_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_-]")
_MAX_NAME = 64
_GRIPPER, _CAMERA = "end_effectors", "cameras"


@blueprint.route(_ADDRESS, methods=["GET"])
def setup() -> str:
    """Show the form of a robot, its gripper and its sensor, filled in from the address."""
    return _shown(flask.request.args)


@blueprint.route(_ADDRESS, methods=["POST"])
def setup_sent() -> str | tuple[str, int]:
    """Store the description of a robot, and show how to go on; or what was wrong at its field."""
    form = flask.request.form
    caller = require_form()
    if form.get("more"):
        return _shown(form, more=form["more"])
    if form.get("take"):
        try:
            read = read_camera_info(form.get(CAMERA_INFO, ""))
            camera = {f"{_CAMERA}.0.{name}": value for name, value in read.items()}
            return _shown(MultiDict({**form.to_dict(), **camera}))
        except UsageError as error:
            return _shown(form, problem=details_of(error)), 422
    require_scope(caller.access, "write")
    sent = flask.request.files.get("urdf")
    urdf = sent.read() if sent and sent.filename else b""
    try:
        if urdf:
            _read(urdf, caller)
        request = read_request(RegisterRobot)
        registered = context().engine.call(_OPERATION, request, caller.access).as_json()
        stored = _store(str(request["name"]), urdf, caller) if urdf else form.get("stored", "")
    except RtaskError as error:
        details = details_of(error)
        return _shown(form, problem=details), details["status"]
    context().audit.event(_OPERATION, by=caller.name)
    name, hand = str(request["name"]), form.get(f"{_GRIPPER}.0.name", "")
    ready = {
        "name": name,
        "robot": registered["robot"],
        "dataset": stored,
        **_code(name, hand, caller),
    }
    return _shown(form, ready=ready)


def offers_kinematics() -> bool:
    """Whether this server can read the model of a robot; that takes the extra ``simulate``."""
    try:
        service_named(KINEMATICS)
    except (MissingExtraError, RefusedError):
        return False
    return True


def _read(urdf: bytes, caller: Caller) -> Any:
    """Let the kinematics read a model, so that one that it refuses is not stored."""
    services = context().services
    return services.call(KINEMATICS, "read", {"urdf": urdf}, caller.access)


def _store(name: str, urdf: bytes, caller: Caller) -> str:
    """Store a model as a version of the robot's dataset, and return its name."""
    plain = _NOT_IN_NAMES.sub("-", name)
    plain = plain if plain[:1].isalpha() else f"r{plain}"
    dataset = f"{ROBOTS}{plain[:_MAX_NAME]}"
    datasets = context().services.datasets
    if dataset not in datasets.names(caller.access):
        datasets.create(dataset, caller.access)
    datasets.put(dataset, {_MODEL: urdf}, caller.access)
    return datasets.snapshot(dataset, f"model of {name}", caller.access).name


def _code(name: str, hand: str, caller: Caller) -> Model:
    """Return a program for the robot; for admins with a new token, shown this once."""
    server, site = context(), current_request().site
    token, login = "", ""
    if "admin" in SCOPES[caller.access.role]:
        token, made = server.tokens.create("robot", agent=name)
        server.audit.event("token-created", token=made.id, role="robot", agent=name, by=caller.name)
    if server.tokens.ever_issued():
        login = f', token="{token or "rtk_..."}"'
    else:
        login = f', agent="{name}"'
    lines = [
        "import sys",
        "from pathlib import Path",
        "",
        "import rtask",
        "",
        "view = Path(sys.argv[1]).read_bytes()  # one object: PCD, PLY or packed; base frame, m",
        f'with rtask.connect("{site}"{login}) as graph:',
        "    found = graph.search_object(data=view)",
        '    if found["outcome"] == "null":  # never seen: remember it',
        f'        graph.insert_object(data=view, gripper_id="{hand}", frame_id="base_link")',
        "        found = graph.search_object(data=view)",
        '    print(found["outcome"], [one["object"] for one in found["similar_objects"]])',
    ]
    return {"token": token, "code": "\n".join(lines)}


def _shown(
    given: MultiDict[str, str],
    more: str = "",
    problem: Model | None = None,
    ready: Model | None = None,
) -> str:
    values = {key: value for key, value in given.items() if key not in ("secret", "more", "take")}
    controls = {control.name: control for control in controls_of(RegisterRobot, values, more)}
    parts = [control for control in controls.values() if control.sort == "group"]
    return flask.render_template(
        "setup.html",
        robot=[control for control in controls.values() if control.sort != "group"],
        grippers=[control for control in parts if control.name.startswith(_GRIPPER)],
        cameras=[control for control in parts if control.name.startswith(_CAMERA)],
        robots=[name for name in readable_datasets() if name.startswith(ROBOTS)],
        install=install_command("simulate"),
        kinematics=KINEMATICS if offers_kinematics() else "",
        given=values,
        problem=problem or {},
        ready=ready,
    )
