"""Object recognition by SIFT, cascade hashing and geometric verification, without training.

::

    features = describe_view(image, mask, depth, intrinsics)
    index = RecognitionIndex(folder)
    index.add(view_iri, object_iri, class_iri, features)
    answer = Recogniser(index).recognise(features)

Every view that is added is found by the next query (Gatto 2016, 3.2.4). IRIs are opaque strings.
"""

from __future__ import annotations

from features.recognition.confidence import ConfidenceParams
from features.recognition.fusion import fuse
from features.recognition.index.folder import IndexLockedError
from features.recognition.index.recognition_index import RecognitionIndex
from features.recognition.index.segments import IndexCorruptError, ViewName
from features.recognition.recogniser import (
    Match,
    Recogniser,
    RecogniserParams,
    Recognition,
    warm_up,
)
from features.recognition.verify import VerifyParams
from features.recognition.views.sift import SiftParams
from features.recognition.views.view import EXTRACTOR, ViewFeatures, describe_frame, describe_view

__all__ = [
    "EXTRACTOR",
    "ConfidenceParams",
    "IndexCorruptError",
    "IndexLockedError",
    "Match",
    "Recogniser",
    "RecogniserParams",
    "Recognition",
    "RecognitionIndex",
    "SiftParams",
    "VerifyParams",
    "ViewFeatures",
    "ViewName",
    "describe_frame",
    "describe_view",
    "fuse",
    "warm_up",
]
