"""Navigation: the sections in the header of every page, the pages below each, and the footer."""

from __future__ import annotations

from typing import NamedTuple

from endpoint.follow.versions import lag_words
from endpoint.pages.render import blueprint, context
from rtask.errors import UnknownTermError
from rtask.extras import missing_libraries

__all__ = ["EXTRA_OF_SERVICE", "MORE", "SECTIONS", "Section", "is_offered", "section_of"]

EXTRA_OF_SERVICE = {"example/Kinematics": "simulate", "example/Trajopt": "simulate"}
"""Services of an installed package that are not offered where its extra is missing."""
_NEEDS = {
    "/tools/grasp": ("example/Grasping",),
    "/tools/arm": ("example/Kinematics", "example/Trajopt"),
    "/tools/pipeline": ("rtask/Pipeline",),
}
"""Services without which there is no such page."""


class Section(NamedTuple):
    """A link of the header, and the pages on which it is the current one."""

    address: str
    name: str
    pages: tuple[str, ...] = ()


SECTIONS = (
    Section("/activity", "Live"),
    Section("/feedback", "Outcomes"),
    Section("/objects", "Objects", ("/object", "/teach", "/curation")),
    Section("/robots", "Robots", ("/robot", "/setup")),
    Section("/world", "World"),
    Section("/plan", "Plans", ("/questions", "/why")),
    Section("/learning", "Learning"),
    Section("/classes", "Classes", ("/terms", "/resource", "/explain")),
    Section("/sparql", "SPARQL", ("/ask",)),
    Section("/services", "Services", ("/datasets", "/jobs", "/operations", "/tools")),
)
"""What one comes to see first, what explains it, what computes it."""
MORE = (
    ("/ask", "Ask in words"),
    ("/terms", "Terms"),
    ("/questions", "Questions of robots"),
    ("/setup", "Set up a robot"),
    ("/teach", "Name objects"),
    ("/tools/grasp", "Grasp editor"),
    ("/tools/arm", "Arm and planning"),
    ("/tools/pipeline", "Compose a pipeline"),
    ("/datasets", "Datasets"),
    ("/jobs", "Jobs"),
    ("/benchmarks", "Benchmarks"),
    ("/openapi", "For programs"),
    ("/admin/tokens", "Operators"),
)


def section_of(path: str) -> str:
    """Return the address of the section that a page belongs to; empty if it belongs to none.

    Examples
    --------
    >>> section_of("/object/merge"), section_of("/services/example/Grasping"), section_of("/")
    ('/objects', '/services', '')
    """
    for section in SECTIONS:
        for start in (section.address, *section.pages):
            if path == start or path.startswith(f"{start}/"):
                return section.address
    return ""


def is_offered(address: str) -> bool:
    """Return whether a server has the services of a page, or the page says what to install."""
    return all(_has_service(service) for service in _NEEDS.get(address, ()))


def _has_service(service: str) -> bool:
    try:
        context().services.registry.find(service)
    except UnknownTermError:
        extra = EXTRA_OF_SERVICE.get(service, "")
        return bool(extra and missing_libraries(extra))
    return True


@blueprint.app_context_processor
def _sections() -> dict[str, object]:
    """Provide templates with the links of header and footer."""
    return {
        "site_sections": [section for section in SECTIONS if is_offered(section.address)],
        "more_pages": [(address, name) for address, name in MORE if is_offered(address)],
        "section_of": section_of,
        "lag": lag_words(context().following),
    }
