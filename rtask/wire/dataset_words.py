"""How readers of a message name the dataset that a service lacks: in Python, a shell, or JSON."""

from __future__ import annotations

__all__ = ["in_words_of", "with_example"]

_EXAMPLE = "; give it as "


def in_words_of(message: str, resource: str, form: str) -> str:
    """Return a message with its example, if it has any, as another reader would write it."""
    return with_example(message, resource, form) if _EXAMPLE in message else message


def with_example(message: str, resource: str, form: str) -> str:
    """Return a message with the way in which its reader names a dataset.

    Parameters
    ----------
    resource
        What the service calls the data.
    form
        ``data=``, ``--dataset``, or the member of a JSON request that holds names of datasets.

    Examples
    --------
    >>> words = with_example("lab/A needs a dataset for 'arm'", "arm", "$data")
    >>> print(words)
    lab/A needs a dataset for 'arm'; give it as "$data": {"arm": "<namespace>/<name>"}
    >>> with_example(words, "arm", "--dataset")
    "lab/A needs a dataset for 'arm'; give it as --dataset arm=<namespace>/<name>"
    """
    example = f'"{form}": {{"{resource}": "<namespace>/<name>"}}'
    if form == "--dataset":
        example = f"--dataset {resource}=<namespace>/<name>"
    elif form == "data=":
        example = f"data={{{resource!r}: '<namespace>/<name>'}}"
    return message.partition(_EXAMPLE)[0] + _EXAMPLE + example
