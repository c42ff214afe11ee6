"""A store with attempts and their pictures, which people judge on the page of outcomes."""

from __future__ import annotations

import datetime as dt
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

import ontology
import rtask
from endpoint.access.tokens import TokenStore

__all__ = ["PHASES", "WIDTHS", "store_of_attempts"]

PREFIXES = f"""
PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>"""
PHASES = ("placed", "pre_grasp", "held", "closed")  # not in the order of time
WIDTHS = {"pre_grasp": 40, "closed": 50, "held": 60, "placed": 80}
"""Of the pictures, px, by which a test tells them apart."""


def store_of_attempts(folder: Path, count: int) -> tuple[str, str]:
    """Fill a folder with attempts of one robot; return the tokens of the teachers ann and bob."""
    with rtask.open(folder, base="urn:lab/") as kb:
        with kb.transaction(agent="nao-1") as tx:
            blobs = {
                phase: tx.blob(_picture(width), "image/png").value
                for phase, width in WIDTHS.items()
            }
        attempts = "".join(_attempt(number, blobs) for number in range(count))
        kb.update(
            f"""{PREFIXES} INSERT DATA {{
            <urn:lab/robot/nao-1> a cora:Robot ; rt:name "nao-1" .
            <urn:lab/hand> a rt:Hand ; rt:gripperType "nao" .
            <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue mug" ;
              rt:hasGrasp <urn:lab/grasp/1> .
            <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" . {attempts} }}""",
            "nao-1",
        )
    with closing(TokenStore(folder)) as tokens:
        ann, bob = (tokens.create("teacher", agent=name)[0] for name in ("ann", "bob"))
    return ann, bob


def _attempt(number: int, blobs: dict[str, str]) -> str:
    begin = dt.datetime(2026, 1, 1, 12, tzinfo=dt.UTC)
    ended = (begin - dt.timedelta(minutes=number)).isoformat()
    name = f"urn:lab/attempt/{number}"
    pictures = "".join(
        f"""<{name}/image/{place}> a rt:ColorImage ; rt:name "{phase}" ;
            rt:hasBlob <{blobs[phase]}> ; prov:wasGeneratedBy <{name}> ."""
        for place, phase in enumerate(PHASES, 1)
    )
    return f"""
  <urn:lab/task/{number}> a rt:Grasp ; rt:handles <urn:lab/object/1> ; rt:through <{name}> .
  <{name}> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/nao-1> ;
    rt:activates <urn:lab/hand> ; rt:executesGrasp <urn:lab/grasp/1> ;
    rt:requestId "urn:task:{number}" ; rt:hasOutcome <urn:lab/outcome/{number}> ;
    prov:endedAtTime "{ended}"^^xsd:dateTime .
  <urn:lab/outcome/{number}> a rt:GraspOutcome ; rt:success true ; rt:hasReason rt:reason_ok ;
    rt:hasFeedback <urn:lab/feedback/{number}> .
  <urn:lab/feedback/{number}> a rt:PhysicsFeedback ; rt:verdict true . {pictures}"""


def _picture(width: int) -> bytes:
    _, png = cv2.imencode(".png", np.full((30, width, 3), 128, np.uint8))
    return bytes(png.tobytes())
