"""Pages for people; each renders data that the same address plus `.json` returns."""

from __future__ import annotations

from endpoint.pages import (
    admin,
    curation,
    feedback,
    home,
    objects,
    operations,
    resource,
    search,
    signin,
    teach,
    wording,
    workbench,
)
from endpoint.pages.render import blueprint

__all__ = [
    "admin",
    "blueprint",
    "curation",
    "feedback",
    "home",
    "objects",
    "operations",
    "resource",
    "search",
    "signin",
    "teach",
    "wording",
    "workbench",
]
