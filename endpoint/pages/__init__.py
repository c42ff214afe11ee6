"""Pages for people; each is a rendering of data that the same address plus `.json` gives."""

from __future__ import annotations

from endpoint.pages import home, objects, resource, robots, workbench
from endpoint.pages.render import blueprint

__all__ = ["blueprint", "home", "objects", "resource", "robots", "workbench"]
