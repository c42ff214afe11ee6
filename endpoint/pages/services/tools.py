"""Pages of tools: an editor of outlines with their push grasps, an arm and its paths.

Kehoe 2014, Figs. 3.9, 5.4 and 5.5.
"""

from __future__ import annotations

from dataclasses import asdict

from endpoint.http.messages import RefusedError
from endpoint.pages.navigation import EXTRA_OF_SERVICE
from endpoint.pages.render import Model, context, page
from endpoint.pages.services.datasets import readable_datasets
from rtask.errors import UnknownTermError
from rtask.extras import missing_libraries, needs_extra
from rtask.services.definition import Definition
from rtask.wire.forms import controls_of

__all__ = ["KINEMATICS", "ROBOTS", "service_named"]

_GRASPING, KINEMATICS, _PLANNING = "example/Grasping", "example/Kinematics", "example/Trajopt"
ROBOTS = "robots/"
_SETTINGS = ("link_radius", "seed", "iterations")
_SCENES: dict[str, Model] = {
    "robots/PlanarArm": {"look": "top", "arm": "arm", "start": [-2.0, 0.0, 0.0],
                         "goal": [2.0, 0.0, 0.0], "balls": [[0.7, 0.0, 0.0, 0.1]]},
    "robots/Point": {"look": "top", "arm": "arm", "start": [-1.0, 0.0], "goal": [1.0, 0.0],
                     "balls": [[0.0, 0.0, 0.0, 0.3]]},
    "robots/Panda": {"look": "free", "start": [-0.9, 0.4, 0.0, -1.9, 0.0, 2.3, 0.8],
                     "goal": [0.9, 0.4, 0.0, -1.9, 0.0, 2.3, 0.8],
                     "balls": [[0.55, 0.0, 0.35, 0.12]]},
    "robots/NAO": {"look": "free"},
}  # fmt: skip
"""Examples of something in the way between two postures; rad or m, and m."""
_PART_UNIT_M = 0.02
"""Size of the unit in which the example parts are drawn: they become 4 to 16 cm long."""


@page("/tools/grasp", "grasp_editor.html")
def grasp_editor() -> Model:
    """Return the settings of the planning service and the example parts, in m."""
    if missing_libraries("perception"):
        raise needs_extra("perception", "the editor of grasps")
    from grasp.push.parts import BRACKETS, SHAPES, TOLERANCING, stand_in

    definition = service_named(_GRASPING)
    groups = {
        "like Fig. 3.8": BRACKETS,
        "simple": SHAPES,
        "like Fig. 3.12": TOLERANCING,
        "like Fig. 3.22": ("tape",),
    }
    controls = controls_of(definition.methods["plan"].request)
    return {
        "service": definition.name,
        "settings": [asdict(control) for control in controls if control.name != "polygon"],
        "parts": {
            group: {name: (stand_in(name) * _PART_UNIT_M).round(6).tolist() for name in names}
            for group, names in groups.items()
        },
    }


@page("/tools/arm", "arm.html")
def arm() -> Model:
    """Return the robots, an example for each, and the settings of the planner."""
    kinematics, planning = service_named(KINEMATICS), service_named(_PLANNING)
    controls = controls_of(planning.methods["plan"].request)
    robots = [name for name in readable_datasets() if name.startswith(ROBOTS)]
    default = planning.resources["robot"].default
    return {
        "kinematics": kinematics.name,
        "planning": planning.name,
        "robots": sorted(robots, key=lambda name: (name != default, name)),
        "scenes": _SCENES,
        "settings": [asdict(control) for control in controls if control.name in _SETTINGS],
    }


def service_named(service: str) -> Definition:
    """Return a service that a page needs.

    Raises
    ------
    MissingExtraError
        It comes with an extra that is not installed.
    RefusedError
        404; it is not offered.
    """
    try:
        return context().services.registry.find(service)
    except UnknownTermError as error:
        extra = EXTRA_OF_SERVICE.get(service, "")
        if extra and missing_libraries(extra):
            raise needs_extra(extra, "this page") from None
        raise RefusedError(404, "not-found", f"this page needs a service: {error}") from None
