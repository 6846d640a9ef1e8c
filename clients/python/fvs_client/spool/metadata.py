"""Metadata of a photograph besides its file: its sidecar, and the result of a callback."""

import json
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path

import pydantic

from fvs_client.models.images import ImageMetadata
from fvs_client.spool.outbox import SIDECAR_REFUSED
from fvs_client.spool.photograph import Refusal

Describe = Callable[[Path], ImageMetadata | None]

_LONGEST_BYTES = 1 << 16


def read_sidecar(path: Path) -> ImageMetadata | Refusal:
    """The metadata in a JSON file: an object with fields of ``ImageMetadata``. Raises ``OSError``."""
    with path.open("rb") as file:
        content = file.read(_LONGEST_BYTES + 1)
    if len(content) > _LONGEST_BYTES:
        return _refusal(path, f"it has more than {_LONGEST_BYTES} bytes")
    try:
        return ImageMetadata.model_validate(json.loads(content))
    except pydantic.ValidationError as error:
        return _refusal(path, _first_mistake(error))
    except ValueError as error:
        return _refusal(path, f"it is not JSON: {error}")


def merged(*known: ImageMetadata | None) -> Mapping[str, object]:
    """The fields of several, as JSON has them; later ones override earlier ones."""
    return {name: value for one in known if one is not None for name, value in one.document().items()}


def _first_mistake(error: pydantic.ValidationError) -> str:
    first = error.errors()[0]
    name = ".".join(map(str, first["loc"]))
    if not name:
        return "it must contain a JSON object"
    if first["type"] != "extra_forbidden":
        return f"{name}: {first['msg']}"
    similar = get_close_matches(name, ImageMetadata.model_fields, 1, 0.3)
    return f"{name} is not a known field" + (f"; did you mean {similar[0]}?" if similar else "")


def _refusal(path: Path, reason: str) -> Refusal:
    return Refusal(
        SIDECAR_REFUSED,
        f"{path.name} cannot be used: {reason}.",
        "Correct or delete it: metadata cannot be sent later than the photograph.",
    )
