"""Domains and ranges of PROV-O, SOSA and OWL-Time, as their recommendations state them.

The ontology declares the terms that it uses of these, and repeats none of their axioms, because
more would then follow from each statement. For a query they tell nevertheless what a term is for.
Sources: W3C, PROV-O, 2013, section 4; Semantic Sensor Network Ontology, 2017, section 4.3; Time
Ontology in OWL, 2022, section 4.
"""

from __future__ import annotations

import ontology

__all__ = ["PROPERTIES"]

_PROV, _SOSA, _TIME = (ontology.PREFIXES[name] for name in ("prov", "sosa", "time"))
_ACTIVITY, _AGENT = _PROV + "Activity", _PROV + "Agent"
_OBSERVATION, _SENSOR = _SOSA + "Observation", _SOSA + "Sensor"
_INSTANT, _INTERVAL = _TIME + "Instant", _TIME + "ProperInterval"

PROPERTIES: dict[str, tuple[str, str]] = {
    _PROV + "used": (_ACTIVITY, ""),
    _PROV + "wasGeneratedBy": ("", _ACTIVITY),
    _PROV + "wasAssociatedWith": (_ACTIVITY, _AGENT),
    _PROV + "wasAttributedTo": ("", _AGENT),
    _PROV + "wasInformedBy": (_ACTIVITY, _ACTIVITY),
    _PROV + "startedAtTime": (_ACTIVITY, ""),
    _PROV + "endedAtTime": (_ACTIVITY, ""),
    _SOSA + "madeBySensor": (_OBSERVATION, _SENSOR),
    _SOSA + "hasFeatureOfInterest": (_OBSERVATION, ""),
    _SOSA + "hasResult": (_OBSERVATION, ""),
    _SOSA + "resultTime": (_OBSERVATION, ""),
    _SOSA + "phenomenonTime": (_OBSERVATION, ""),
    _TIME + "hasBeginning": (_INTERVAL, _INSTANT),
    _TIME + "hasEnd": (_INTERVAL, _INSTANT),
    _TIME + "inXSDDateTimeStamp": (_INSTANT, ""),
}
"""Classes of subject and value by property; empty where anything may stand. What a recommendation
calls an entity may be anything here, so that prov:Entity is left out."""
