"""What an answer that is no success means."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.errors import AuthenticationError, CallFailedError, ForbiddenError

if TYPE_CHECKING:
    import httpx

__all__ = ["failure_of"]


def failure_of(answer: httpx.Response) -> Exception:
    """Return the error of an answer, with the words of its problem details (RFC 9457)."""
    try:
        problem = answer.json()
        words = str(problem.get("detail") or problem.get("title"))
    except (ValueError, AttributeError):
        words = answer.text[:500] or answer.reason_phrase
    if answer.status_code == 401:
        return AuthenticationError(words)
    if answer.status_code == 403:
        return ForbiddenError(words)
    return CallFailedError(words, http_status=answer.status_code)
