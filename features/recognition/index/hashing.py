"""Binary codes of descriptors: what cascade hashing looks up and ranks by.

Cheng 2014, 3.1 and 3.2: signs of random projections, once as short bucket numbers of several
tables, once as a longer code whose Hamming distance stands in for the Euclidean one. Nothing is
trained; the mean that centres the descriptors is frozen, because a mean that follows the data
would make every stored code stale.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.nearest import inner_products

__all__ = ["CODE_BITS", "TABLES", "TABLE_BITS", "Hasher", "used_table_bits"]

CODE_BITS = 128
TABLES = 8
TABLE_BITS = 20
SEED = 20160401
_PROJECTION_SCALE = 64

# Mean RootSIFT descriptor (scale 512) of 61 thousand descriptors of 107 real table-top images,
# in OpenCV's 4 x 4 cells x 8 orientations; renders of objects have cosine .997 with it.
_MEAN = """
34 29 27 28 32 21 18 21 71 43 28 25 27 20 20 35 74 38 21 20 24 21 23 40 38 23 17 18 26 23 23 27
43 30 27 33 40 27 20 25 90 49 28 31 36 25 22 43 93 46 22 24 31 25 25 45 48 26 19 23 32 26 23 29
43 25 20 28 40 32 27 30 91 44 22 25 36 30 28 48 93 45 25 26 31 23 22 46 48 29 23 26 32 22 18 26
34 21 17 21 32 28 27 29 71 35 20 20 27 24 28 43 73 39 23 21 24 19 21 38 38 27 22 22 25 18 17 23
"""


def used_table_bits(rows: int) -> int:
    """Return how many bits of a bucket number to use for an index of so many descriptors.

    Too many bits for few descriptors leave about ten candidates in a bucket: the true second
    neighbour is then missing and the ratio test passes too easily.

    Examples
    --------
    >>> [used_table_bits(n) for n in (0, 500, 50_000, 3_000_000)]
    [8, 8, 13, 18]
    """
    return int(np.clip(round(float(np.log2(max(rows, 1)))) - 3, 8, 18))


@dataclass(frozen=True)
class Hasher:
    """Frozen mean and projections that turn descriptors into codes and bucket numbers.

    Parameters
    ----------
    mean : (128,) int16
        Subtracted from every descriptor.
    code_projections : (128, 128) int16
        One row per bit of the code.
    table_projections : (160, 128) int16
        ``TABLE_BITS`` rows for each of the ``TABLES`` tables.

    Notes
    -----
    Projections are whole numbers of at most 9 bits: the product gives the same bits on every
    platform.

    Examples
    --------
    >>> codes, buckets = Hasher.seeded().encode(np.zeros((3, 128), np.uint8))
    >>> codes.shape, buckets.shape
    ((3, 2), (3, 8))
    """

    mean: NDArray[np.int16]
    code_projections: NDArray[np.int16]
    table_projections: NDArray[np.int16]

    @classmethod
    def seeded(cls, seed: int = SEED) -> Hasher:
        """Draw the projections from a seed; an index stores what was drawn."""
        gauss = np.random.Generator(np.random.PCG64(seed)).standard_normal(
            (CODE_BITS + TABLES * TABLE_BITS, 128)
        )
        rounded = np.clip(np.rint(gauss * _PROJECTION_SCALE), -511, 511).astype(np.int16)
        mean = np.array(_MEAN.split(), dtype=np.int16)
        return cls(mean, rounded[:CODE_BITS], rounded[CODE_BITS:])

    def encode(self, descriptors: UInt8Array) -> tuple[NDArray[np.uint64], NDArray[np.uint32]]:
        """Return codes and bucket numbers.

        Parameters
        ----------
        descriptors : (n, 128) uint8

        Returns
        -------
        codes : (n, 2) uint64
            128 bits, bit 0 = lowest bit of the first word.
        buckets : (n, TABLES) uint32
            All ``TABLE_BITS`` bits of each table; an index uses the lowest of them.
        """
        if descriptors.ndim != 2 or descriptors.shape[1] != 128:
            raise ValueError(f"descriptors must have shape (n, 128), got {descriptors.shape}")
        centred = descriptors.astype(np.int16) - self.mean
        signs = inner_products(centred, self.code_projections) > 0
        codes = np.packbits(signs, axis=1, bitorder="little").view("<u8").astype(np.uint64)
        signs = inner_products(centred, self.table_projections) > 0
        weights = np.uint32(1) << np.arange(TABLE_BITS, dtype=np.uint32)
        per_table = signs.reshape(len(centred), TABLES, TABLE_BITS)
        buckets = (per_table * weights).sum(axis=-1, dtype=np.uint32)
        return codes, buckets

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what an index keeps in its header."""
        return {
            "mean": self.mean,
            "code_projections": self.code_projections,
            "table_projections": self.table_projections,
        }

    def digest(self) -> str:
        """Return a fingerprint: codes made with another fingerprint cannot be compared."""
        state = hashlib.sha256()
        for name, array in sorted(self.arrays().items()):
            state.update(name.encode())
            state.update(np.ascontiguousarray(array.astype("<i2")).tobytes())
        return state.hexdigest()
