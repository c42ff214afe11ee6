"""Pages of tools: an editor of outlines that shows their push grasps (Kehoe 2014, Fig. 5.5)."""

from __future__ import annotations

from dataclasses import asdict

from endpoint.http.messages import RefusedError
from endpoint.pages.render import Model, context, page
from rtask.errors import UnknownTermError
from rtask.wire.forms import controls_of

_SERVICE = "example/Grasping"
_PART_UNIT_M = 0.02
"""Size of the unit in which the example parts are drawn: they become 4 to 16 cm long."""


@page("/tools/grasp", "grasp_editor.html")
def grasp_editor() -> Model:
    """Return the settings of the planning service and the example parts, in m."""
    from grasp.push.parts import BRACKETS, SHAPES, TOLERANCING, stand_in

    try:
        definition = context().services.registry.find(_SERVICE)
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", f"this page needs a service: {error}") from None
    groups = {
        "like Fig. 3.8": BRACKETS,
        "simple": SHAPES,
        "like Fig. 3.12": TOLERANCING,
        "like Fig. 3.22": ("tape",),
    }
    controls = controls_of(definition.methods["plan"].request)
    return {
        "service": definition.name,
        "settings": [asdict(one) for one in controls if one.name != "polygon"],
        "parts": {
            group: {name: (stand_in(name) * _PART_UNIT_M).round(6).tolist() for name in names}
            for group, names in groups.items()
        },
    }
