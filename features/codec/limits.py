"""Limits of the decoders, checked before memory is allocated, and the error that they raise."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CloudFormatError", "Limits", "UnknownFormatError"]


class CloudFormatError(ValueError):
    """Bytes that are no cloud, a damaged one, or one beyond the limits: what, and where."""


class UnknownFormatError(CloudFormatError):
    """Bytes that begin like nothing that is read."""


@dataclass(frozen=True)
class Limits:
    """Bounds on what comes in.

    Parameters
    ----------
    stored_bytes, decoded_bytes
        Of one message, before and after unpacking.
    points
        Of one cloud.
    side_px, area_px
        Of one image.
    ratio
        Decoded over stored size; more is taken for a bomb.
    """

    stored_bytes: int = 32 * 2**20
    decoded_bytes: int = 256 * 2**20
    points: int = 5_000_000
    side_px: int = 8_192
    area_px: int = 16_000_000
    ratio: int = 1_000

    def check_stored(self, size: int) -> None:
        """Refuse a message that is too large as it came."""
        if size > self.stored_bytes:
            raise CloudFormatError(f"{size} bytes; at most {self.stored_bytes} are accepted")

    def check_decoded(self, decoded: int, stored: int, what: str) -> None:
        """Refuse to unpack something that would become too large."""
        if decoded > self.decoded_bytes:
            raise CloudFormatError(
                f"{what}: unpacks to {decoded} bytes; at most {self.decoded_bytes} are accepted"
            )
        if decoded > self.ratio * max(stored, 1):
            raise CloudFormatError(
                f"{what}: {stored} bytes unpack to {decoded}, more than {self.ratio} times as much"
            )

    def check_points(self, points: int) -> None:
        """Refuse a cloud of too many points."""
        if points > self.points:
            raise CloudFormatError(f"{points} points; at most {self.points} are accepted")

    def check_image(self, width: int, height: int) -> None:
        """Refuse an image that is too large, from its header alone."""
        if max(width, height) > self.side_px or width * height > self.area_px:
            raise CloudFormatError(
                f"image of {width}x{height} px; at most {self.side_px} px a side and "
                f"{self.area_px} px in all are accepted"
            )
