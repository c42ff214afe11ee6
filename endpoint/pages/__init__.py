"""Pages for people; each renders data that the same address plus `.json` returns."""

from __future__ import annotations

from endpoint.pages import (
    activity,
    admin,
    clouds,
    curation,
    feedback,
    home,
    objects,
    operations,
    search,
    services,
    signin,
    teach,
    tools,
    wording,
)
from endpoint.pages.graph import classes, proof, resource, workbench
from endpoint.pages.render import blueprint

__all__ = [
    "activity",
    "admin",
    "blueprint",
    "classes",
    "clouds",
    "curation",
    "feedback",
    "home",
    "objects",
    "operations",
    "proof",
    "resource",
    "search",
    "services",
    "signin",
    "teach",
    "tools",
    "wording",
    "workbench",
]
