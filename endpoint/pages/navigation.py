"""Navigation: the sections in the header of every page, the pages below each, and the footer."""

from __future__ import annotations

from typing import NamedTuple

from endpoint.pages.render import blueprint

__all__ = ["MORE", "SECTIONS", "Section", "section_of"]


class Section(NamedTuple):
    """A link of the header, and the pages on which it is the current one."""

    address: str
    name: str
    pages: tuple[str, ...] = ()


SECTIONS = (
    Section("/activity", "Live"),
    Section("/feedback", "Outcomes"),
    Section("/objects", "Objects", ("/object", "/teach", "/curation")),
    Section("/robots", "Robots", ("/robot", "/setup", "/plan", "/questions")),
    Section("/world", "World"),
    Section("/learning", "Learning"),
    Section("/classes", "Classes", ("/terms", "/resource", "/explain")),
    Section("/sparql", "SPARQL", ("/ask",)),
    Section("/services", "Services", ("/datasets", "/jobs", "/operations", "/tools/pipeline")),
    Section("/tools/grasp", "Grasps"),
    Section("/tools/arm", "Arms"),
)
"""What one comes to see first, what explains it, what computes it."""
MORE = (
    ("/ask", "Ask in words"),
    ("/terms", "Terms"),
    ("/plan", "Plan a task"),
    ("/questions", "Questions of robots"),
    ("/setup", "Set up a robot"),
    ("/teach", "Name objects"),
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


@blueprint.app_context_processor
def _sections() -> dict[str, object]:
    """Provide templates with the links of header and footer."""
    return {"site_sections": SECTIONS, "more_pages": MORE, "section_of": section_of}
