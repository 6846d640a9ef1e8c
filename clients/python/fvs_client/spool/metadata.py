"""Metadata of a photograph besides its file: its sidecar, and the result of a callback."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from fvs_client.spool.outbox import SIDECAR_REFUSED
from fvs_client.spool.photograph import Refusal
from fvs_schema.images import ImageMetadata

Describe = Callable[[Path], ImageMetadata | None]

_LONGEST_BYTES = 1 << 16


def read_sidecar(path: Path) -> ImageMetadata | Refusal:
    """The metadata in a JSON file: an object with fields of ``ImageMetadata``. Raises ``OSError``."""
    with path.open("rb") as file:
        content = file.read(_LONGEST_BYTES + 1)
    if len(content) > _LONGEST_BYTES:
        return _refusal(path, f"it has more than {_LONGEST_BYTES} bytes")
    try:
        fields = json.loads(content)
    except ValueError as error:
        return _refusal(path, f"It is not JSON: {error}.")
    if not isinstance(fields, dict):
        return _refusal(path, "It must contain a JSON object.")
    try:
        return ImageMetadata(**fields)
    except ValueError as error:
        return _refusal(path, str(error))


def merged(*known: ImageMetadata | None) -> Mapping[str, object]:
    """The fields of several, as JSON has them; later ones override earlier ones."""
    documents = [one.model_dump(mode="json", exclude_none=True) for one in known if one is not None]
    return {name: value for document in documents for name, value in document.items()}


def _refusal(path: Path, reason: str) -> Refusal:
    return Refusal(
        SIDECAR_REFUSED,
        f"{path.name} cannot be used. {reason}",
        "Correct or delete it: metadata cannot be sent later than the photograph.",
    )
