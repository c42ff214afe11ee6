"""A user's ONNX network as a feature of views (extra ``embed``).

No network ships with the project, and nothing is trained: any image encoder with one input of an
image and an output of one vector will do, such as an exported DINO or CLIP image tower.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["Embedder", "vector_from_bytes", "vector_to_bytes"]

_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_DEVIATION = np.array([0.229, 0.224, 0.225], np.float32)
_DEFAULT_PX = 224
_BACKGROUND = 127
_MAX_LENGTH = 16_384


class Embedder:
    """Turns crops of objects into unit vectors.

    Parameters
    ----------
    model
        ONNX file with one input (1, 3, h, w) or (1, h, w, 3) float32: RGB, scaled as for ImageNet.
        Its first output is the vector; of one vector for each patch, the mean.
    threads
        Of the runtime for one call.

    Attributes
    ----------
    digest
        SHA-256 of the file: vectors of different networks cannot be compared.

    Raises
    ------
    ModuleNotFoundError
        onnxruntime is not installed.
    ValueError
        The file is no network, or one of another form.
    """

    def __init__(self, model: Path | str, threads: int = 1) -> None:
        import onnxruntime

        data = Path(model).read_bytes()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime's errors have no narrower base in common
            raise ValueError(f"{model}: not a network that onnxruntime runs: {error}") from error
        self.digest = hashlib.sha256(data).hexdigest()
        inputs = self._session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) != 4 or inputs[0].type != "tensor(float)":
            raise ValueError(f"{model}: expected one input (1, 3, h, w) of float32, got {inputs}")
        self._input = inputs[0].name
        shape: list[Any] = list(inputs[0].shape)
        self._channels_last = shape[3] == 3 and shape[1] != 3
        sides = shape[1:3] if self._channels_last else shape[2:4]
        self._size = tuple(
            side if isinstance(side, int) and side > 0 else _DEFAULT_PX for side in sides
        )

    def embed(self, rgb: UInt8Array, mask: NDArray[np.bool_] | None = None) -> NDArray[np.float32]:
        """Return the unit vector (d,) of an object.

        Parameters
        ----------
        rgb : (h, w, 3) uint8
            Crop of the object.
        mask : (h, w) bool or None
            Its pixels; the rest is painted grey.

        Raises
        ------
        ValueError
            When the network gives no vector, or one without a direction.
        """
        image = rgb if mask is None else np.where(mask[..., None], rgb, np.uint8(_BACKGROUND))
        pixels = (_fitted(np.asarray(image, np.uint8), self._size) / 255.0 - _MEAN) / _DEVIATION
        batch = pixels[None] if self._channels_last else pixels.transpose(2, 0, 1)[None]
        given = {self._input: np.ascontiguousarray(batch, dtype=np.float32)}
        values = np.asarray(self._session.run(None, given)[0], np.float32)
        flat = values.reshape(-1, values.shape[-1]).mean(axis=0) if values.ndim == 3 else values
        vector = flat.ravel()
        length = float(np.linalg.norm(vector))
        if not 1 < len(vector) <= _MAX_LENGTH or not np.isfinite(length) or length < 1e-12:
            raise ValueError(f"the network gave no vector: shape {values.shape}, length {length:g}")
        return np.asarray(vector / length, dtype=np.float32)


def _fitted(image: UInt8Array, size: tuple[int, ...]) -> NDArray[np.float32]:
    """Return an image at the network's size, its sides in proportion, grey beside it."""
    height, width = size
    scale = min(height / image.shape[0], width / image.shape[1])
    inner = (max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image, inner, interpolation=way)
    left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
    whole = np.full((height, width, 3), _BACKGROUND, np.float32)
    whole[top : top + inner[1], left : left + inner[0]] = small
    return whole


def vector_to_bytes(vector: NDArray[np.float32], digest: str) -> bytes:
    """Return a vector and the network's digest as an ``.npz``."""
    buffer = io.BytesIO()
    np.savez(buffer, vector=vector.astype("<f4"), network=np.frombuffer(digest.encode(), np.uint8))
    return buffer.getvalue()


def vector_from_bytes(data: bytes, digest: str) -> NDArray[np.float32]:
    """Return what :func:`vector_to_bytes` wrote.

    Raises
    ------
    ValueError
        When it is something else, or of another network.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            vector, network = arrays["vector"], arrays["network"].tobytes().decode()
    except (zipfile.BadZipFile, KeyError, OSError, EOFError, ValueError) as error:
        raise ValueError(f"these bytes are no vector of a view: {error}") from error
    if network != digest:
        raise ValueError(f"a vector of network {network[:12]}, not of {digest[:12]}")
    return np.asarray(vector, dtype=np.float32)
