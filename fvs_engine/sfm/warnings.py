"""Warnings of structure from motion that stop being true: how they begin, and which are still true.

Warnings are sentences for the user, also on disk and in reports. Those about a model's cameras end when it is
replaced, those about an image without a pose when the image is registered.
"""

from collections.abc import Iterable

_DOUBTFUL = "DOUBTFUL CAMERAS:"
_UNREGISTERED = " is not registered: "


def doubtful(reasons: str) -> str:
    """The warning that a model is used although it may be wrong; ``reasons`` are sentences."""
    return f"{_DOUBTFUL} {reasons}"


def not_registered(name: str, reason: str) -> str:
    """The warning that an image was matched and has no pose, and the remedy."""
    return f"{name}{_UNREGISTERED}{reason}. Photographs from between it and the others would help."


def without_doubts(warnings: Iterable[str]) -> tuple[str, ...]:
    """The ``warnings`` that are still true when the model has been replaced."""
    return tuple(warning for warning in warnings if _DOUBTFUL not in warning)


def without_registered(warnings: Iterable[str], registered: Iterable[str]) -> tuple[str, ...]:
    """The ``warnings`` that are still true when these images are ``registered``."""
    ended = tuple(f"{name}{_UNREGISTERED}" for name in registered)
    return tuple(warning for warning in warnings if not warning.startswith(ended))
