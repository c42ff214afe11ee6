"""Attempts that count as evidence about a grasp, as a SPARQL pattern."""

from __future__ import annotations

from rtask.engine.policy import UNJUDGED
from rtask.rdf.namespaces import reason

__all__ = ["JUDGED"]

JUDGED = f"""?attempt rt:executesGrasp ?grasp ; prov:endedAtTime ?ended ; rt:hasOutcome ?outcome .
    ?outcome rt:hasReason ?reason ; rt:success ?decided
    BIND(IF(?decided, !EXISTS {{ ?outcome rt:judgedSuccess false }},
      EXISTS {{ ?outcome rt:judgedSuccess true }}) AS ?held)
    FILTER(?held != ?decided || ?reason NOT IN ({", ".join(map(str, map(reason, UNJUDGED)))}))
    FILTER NOT EXISTS {{ ?outcome rt:disputed true }}"""
"""Pattern of a judged attempt of ``?grasp``: verdicts of people override the report, and disputed
attempts are left out."""
