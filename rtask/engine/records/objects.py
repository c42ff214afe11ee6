"""Objects and their views as triples (Gatto 2016, 3.2.2).

The image crop, the compressed cloud and the descriptors of a view are blobs; size and frame are
numbers. The recognition index can be rebuilt from these.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.engine.names import tail
from rtask.engine.observation import Observation
from rtask.engine.perception.colours import colours_of
from rtask.engine.perception.images import encode_crop
from rtask.engine.perception.placement import Placement
from rtask.engine.triples import Triples, stamp
from rtask.errors import ForgottenError, UnknownTermError, nearest
from rtask.rdf.namespaces import PREFIXES, PROV, RDF, RT, SOSA
from rtask.rdf.terms import NamedNode, iri, literal, object_term, python_value

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition
    from rtask.engine.context import Context

__all__ = [
    "ObjectRecord",
    "Sight",
    "body_frame",
    "frame_id_of",
    "is_forgotten",
    "no_object",
    "resolve_object",
    "state_frame",
    "state_object",
    "state_recognition",
    "state_view",
    "stored_mass",
    "viewpoint_of",
]

_CLOUD = "application/vnd.rtask.cloud"
MAX_MATCHES = 3


@dataclass(frozen=True)
class ObjectRecord:
    """A new object to be stored.

    Parameters
    ----------
    iri, object_id, name
        ``object_id`` is ``namespace/number`` and never reused.
    class_iri
        Kind of object.
    class_confidence
        Confidence in a class guessed from the shape; None = it was stated.
    """

    iri: NamedNode
    object_id: str
    name: str
    class_iri: NamedNode | None = None
    class_confidence: float | None = None
    function: NamedNode | None = None


@dataclass(frozen=True)
class Sight:
    """An observation of an object, with the IRIs of its records.

    Parameters
    ----------
    object_from_camera : (4, 4) or None, m
        Pose of the camera by the object's model; None = by ``placement``.
    """

    observation: Observation
    placement: Placement | None
    view: NamedNode
    event: NamedNode
    camera: NamedNode | None
    agent: NamedNode
    request_id: str | None
    time: dt.datetime
    object_from_camera: NDArray[np.float64] | None = None


def resolve_object(context: Context, name: str) -> str:
    """Return the IRI of the object with this IRI, objectId or name.

    Raises
    ------
    UnknownTermError
        With the nearest name.
    ForgottenError
        It was forgotten.
    """
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?object ?name WHERE {{ ?object rt:objectId ?id
  OPTIONAL {{ ?object rt:name ?name }}
  FILTER(STR(?object) = {literal(name)} || ?id = {literal(name)} || ?name = {literal(name)})
}} ORDER BY ?object""")
    if rows:
        return str(rows[0].value("object"))
    if is_forgotten(context, name):
        raise no_object(context, name)
    names = context.kb.select(
        f"{PREFIXES} SELECT DISTINCT ?n {{ ?o rt:objectId ?id ; rt:name ?n }} ORDER BY ?n"
    )
    hint = nearest(name, [str(row.value("n")) for row in names])
    raise UnknownTermError(f"unknown object {name!r}{hint}")


def is_forgotten(context: Context, name: str) -> bool:
    """Whether a text is the IRI of an object that was forgotten."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?gone {{ ?gone prov:invalidatedAtTime ?time FILTER(STR(?gone) = {literal(name)})
  FILTER NOT EXISTS {{ ?gone rt:poseOf ?thing }} }} LIMIT 1""")
    return bool(rows)


def no_object(context: Context, name: str, field: str = "object") -> UnknownTermError:
    """Return the error about an IRI that stands for no object, or for one that was forgotten."""
    if is_forgotten(context, name):
        return ForgottenError(f"{field}: the object {name} was forgotten", field=field)
    return UnknownTermError(f"{field}: the graph has no object {name}", field=field)


def body_frame(context: Context, object_iri: NamedNode) -> NamedNode:
    """Return the frame that moves with an object, stored or to be stored."""
    stored = [] if context.names.is_new(object_iri) else context.kb.match(object_iri, RT.bodyFrame)
    for quad in stored:
        if isinstance(quad.object, NamedNode):
            return quad.object
    return context.names.named("frame", f"object-{tail(object_iri)}")


def stored_mass(context: Context, object_iri: str) -> float | None:
    """Return the mass of an object, kg, or None if it is not known."""
    for quad in context.kb.match(iri(object_iri), RT.mass):
        mass = float(str(python_value(object_term(quad.object))))
        # 0 means not known, as where a field of a message was left out: nothing weighs nothing.
        return mass if mass > 0 else None
    return None


def frame_id_of(context: Context, object_iri: str) -> str:
    """Return the name of an object's frame in messages."""
    for quad in context.kb.match(body_frame(context, iri(object_iri)), RT.frameId):
        return str(python_value(object_term(quad.object)))
    return f"object/{tail(iri(object_iri))}"


def state_frame(context: Context, triples: Triples, object_iri: NamedNode) -> None:
    """Add an object's frame unless it has one; objects from other sources may lack it."""
    # A name that was made in this call has no triples yet: it need not be looked for.
    if context.names.is_new(object_iri) or not context.kb.match(object_iri, RT.bodyFrame):
        frame = body_frame(context, object_iri)
        triples.add(object_iri, RT.bodyFrame, frame)
        triples.node(frame, [RT.Frame], {RT.frameId: f"object/{tail(object_iri)}"})


def state_object(
    context: Context, triples: Triples, new: ObjectRecord, observation: Observation
) -> None:
    """Add a new object: identity, class, colours, size, frame, symmetry."""
    shape = observation.shape
    frame = body_frame(context, new.iri)
    triples.node(
        new.iri,
        [RT.ManipulableObject],
        {
            RT.objectId: new.object_id,
            RT.name: new.name,
            RT.hasFunction: new.function,
        },
    )
    state_frame(context, triples, new.iri)
    if new.class_iri is not None and new.class_confidence is None:
        triples.node(new.iri, [new.class_iri], {})
    elif new.class_iri is not None and new.class_confidence is not None:
        reifier = context.names.unique("statement")
        triples.with_confidence(reifier, new.iri, RDF.type, new.class_iri, new.class_confidence)
    # Colours are stated even of a view without a pose; sizes only hold where the table is known.
    for colour in colours_of(observation.frame):
        triples.add(new.iri, RT.hasColour, getattr(RT, f"colour_{colour}"))
    if shape is None or not observation.is_posed:
        return
    triples.node(
        new.iri,
        [],
        {
            RT.extentX: max(float(shape.length), 1e-3),
            RT.extentY: max(float(shape.width), 1e-3),
            RT.extentZ: max(float(shape.height), 1e-3),
            RT.graspWidth: max(float(shape.width), 1e-3),
            RT.roundness: float(np.clip(shape.roundness, 0.0, 1.0)),
        },
    )
    if shape.is_round:
        symmetry, axis = context.names.unique("symmetry"), context.names.unique("direction")
        triples.add(new.iri, RT.hasSymmetry, symmetry)
        triples.node(symmetry, [RT.Symmetry], {RT.symmetryOrder: 0, RT.symmetryAxis: axis})
        triples.node(
            axis,
            [RT.Direction],
            {RT.inFrame: frame, RT.dirX: 0.0, RT.dirY: 0.0, RT.dirZ: 1.0},
        )


def viewpoint_of(seen: Observation, placement: Placement) -> NDArray[np.float64]:
    """Return the pose (4, 4) of the camera in the frame of an object placed like this."""
    pose = np.linalg.inv(placement.frame_from_object) @ seen.frame_from_camera
    return np.asarray(pose, dtype=np.float64)


def state_view(context: Context, triples: Triples, object_iri: NamedNode, sight: Sight) -> None:
    """Add a view of an object: bytes, viewpoint, author and time."""
    seen = sight.observation
    triples.node(
        sight.event,
        [RT.Observation],
        {
            SOSA.madeBySensor: sight.camera,
            SOSA.hasFeatureOfInterest: object_iri,
            SOSA.resultTime: sight.time,
            PROV.wasAssociatedWith: sight.agent,
            RT.requestId: sight.request_id,
        },
    )
    triples.add(object_iri, RT.hasView, sight.view)
    triples.node(sight.view, [RT.View], {PROV.wasDerivedFrom: sight.event})
    triples.add(sight.view, RT.atTime, stamp(sight.time))
    object_from_camera = sight.object_from_camera
    if object_from_camera is None and sight.placement is not None and sight.placement.is_verified:
        object_from_camera = viewpoint_of(seen, sight.placement)
    if object_from_camera is not None:
        pose = iri(sight.view.value + "/viewpoint")
        triples.add(sight.view, RT.viewpoint, pose)
        triples.pose(pose, body_frame(context, object_iri), object_from_camera)
    for name, kinds, properties in _contents(context, triples, seen):
        content = iri(f"{sight.view.value}/{name}")
        triples.add(sight.view, RT.viewContent, content)
        triples.node(
            content,
            kinds,
            {**properties, RT.acquiredBy: sight.camera, PROV.wasGeneratedBy: sight.event},
        )


def _contents(
    context: Context, triples: Triples, seen: Observation
) -> list[tuple[str, list[NamedNode], dict[NamedNode, Any]]]:
    """Return name, classes and properties of a view's contents after storing their bytes."""
    blobs = context.kb.blobs
    picture = blobs.put(encode_crop(seen.frame), "image/jpeg")
    is_own = seen.data.startswith(b"RTKC")
    cloud = blobs.put(seen.data, _CLOUD if is_own else "application/octet-stream")
    described = blobs.put(seen.features.to_bytes(), "application/x-npz")
    height, width = seen.frame.depth_m.shape
    return [
        (
            "image",
            [RT.ColorImage, *([RT.CloudImage] if seen.is_rendered else [])],
            {RT.hasBlob: triples.blob(picture), RT.widthPx: width, RT.heightPx: height,
             RT.encoding: "rgb8"},
        ),
        (
            "cloud",
            [RT.CompressedPointCloud],
            {RT.hasBlob: triples.blob(cloud), RT.pointCount: len(seen.points),
             RT.codec: "RTKC/1" if is_own else "foreign"},
        ),
        (
            "descriptors",
            [RT.SIFTFeatureSet],
            {RT.hasBlob: triples.blob(described), RT.descriptorCount: len(seen.features),
             RT.descriptorLength: 128, RT.elementType: "uint8"},
        ),
        *_visual_features(context, triples, seen),
    ]  # fmt: skip


def _visual_features(
    context: Context, triples: Triples, seen: Observation
) -> list[tuple[str, list[NamedNode], dict[NamedNode, Any]]]:
    """Return HOG, FPFH and B-splines of a view (Gatto 2016, 3.2.2); after storing their bytes."""
    from features.recognition.views.stored import stored_features

    return [
        (
            feature.kind.lower(),
            [getattr(RT, feature.kind)],
            {
                RT.hasBlob: triples.blob(context.kb.blobs.put(feature.data, "application/x-npz")),
                **{getattr(RT, name): value for name, value in feature.numbers.items()},
            },
        )
        for feature in stored_features(seen.features, seen.frame)
    ]


def state_recognition(
    context: Context, triples: Triples, recognition: Recognition, event: NamedNode | None
) -> NamedNode:
    """Add the result of recognition and return its IRI."""
    result = context.names.unique("recognition")
    matches = recognition.matches
    triples.node(
        result,
        [RT.RecognitionResult],
        {
            RT.recognitionConfidence: float(matches[0].confidence) if matches else 0.0,
            RT.matchCount: len(matches),
            RT.recognisedFrom: event,
        },
    )
    for rank, match in enumerate(matches[:MAX_MATCHES], start=1):
        node = iri(f"{result.value}/match/{rank}")
        triples.add(result, RT.hasMatch, node)
        triples.node(
            node,
            [RT.Match],
            {
                RT.rank: rank,
                RT.matchScore: float(match.confidence),
                RT.inlierCount: int(match.inliers),
                RT.matchedObject: iri(match.object_iri),
            },
        )
        if rank == 1 and recognition.accepted:
            triples.add(result, RT.bestMatch, node)
    return result
