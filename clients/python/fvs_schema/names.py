"""Names and ids that senders choose, and the forms that they have."""

import re
from typing import Annotated

from pydantic import Field

_NAME = "letters, digits and . _ ~ : @ + -, of which the first is a letter or a digit"
_CANDIDATE = r"^[A-Za-z0-9][A-Za-z0-9._~:@+-]{0,127}$"
_VEHICLE = r"^[A-Za-z0-9][A-Za-z0-9._~:@+-]{0,63}$"
_DIGEST = r"^sha256:[0-9a-f]{64}$"
_IMAGE = r"^[^/\\\x00-\x1f\x7f]+$"
_SCENE = r"^[^\x00-\x1f\x7f]+$"

FORMS = {
    _CANDIDATE: f"it must be 1 to 128 {_NAME}",
    _VEHICLE: f"it must be 1 to 64 {_NAME}",
    _DIGEST: "it must be sha256: and 64 lower-case hexadecimal digits",
    _IMAGE: "it must not have slashes, backslashes or control characters",
    _SCENE: "it must not have control characters",
}
"""What is said of a name, by the pattern that it does not match."""

CandidateId = Annotated[str, Field(pattern=_CANDIDATE)]
VehicleName = Annotated[str, Field(pattern=_VEHICLE)]
Digest = Annotated[str, Field(pattern=_DIGEST)]
"""The SHA-256 of an image's bytes."""
ImageName = Annotated[str, Field(min_length=1, max_length=255, pattern=_IMAGE)]
"""The sender's name of the image; it is never a path."""
SceneName = Annotated[str, Field(min_length=1, max_length=200, pattern=_SCENE)]
"""A name for people; several scenes may have the same."""

_UNDECODABLE = re.compile("[\udc80-\udcff]")
"""What Python makes of the bytes of a file's name that are not UTF-8."""


def readable_name(name: str) -> str:
    """The name of a file as text that can be printed and stored: a byte that is not UTF-8 becomes ``%E9``."""
    return _UNDECODABLE.sub(lambda found: f"%{ord(found[0]) - 0xDC00:02X}", name)
