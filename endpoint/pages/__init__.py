"""Pages for people; each renders data that the same address plus `.json` returns."""

from __future__ import annotations

from endpoint.pages import (
    activity,
    admin,
    benchmarks,
    clouds,
    curation,
    feedback,
    home,
    learning,
    navigation,
    objects,
    operations,
    robots,
    search,
    signin,
    teach,
)
from endpoint.pages.graph import ask, classes, proof, resource, terms, workbench, world
from endpoint.pages.render import blueprint
from endpoint.pages.services import datasets, forms, jobs, pipeline, setup, tools
from endpoint.pages.tasks import plan, questions, why

__all__ = [
    "activity",
    "admin",
    "ask",
    "benchmarks",
    "blueprint",
    "classes",
    "clouds",
    "curation",
    "datasets",
    "feedback",
    "forms",
    "home",
    "jobs",
    "learning",
    "navigation",
    "objects",
    "operations",
    "pipeline",
    "plan",
    "proof",
    "questions",
    "resource",
    "robots",
    "search",
    "setup",
    "signin",
    "teach",
    "terms",
    "tools",
    "why",
    "workbench",
    "world",
]
