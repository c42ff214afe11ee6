"""The one error that reading a cloud raises."""

from __future__ import annotations

__all__ = ["CloudFormatError"]


class CloudFormatError(ValueError):
    """Bytes that are no cloud, a damaged one, or one beyond the limits: what, and where."""
