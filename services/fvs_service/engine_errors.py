"""What the engine and libraries say, for clients: errors of the service, without folders of this machine."""

import os
import sys
import tempfile
from pathlib import Path

from fvs_engine.errors import BackendUnavailableError, Cancelled, EngineError, InvalidInputError
from fvs_service.errors import (
    InternalError,
    InvalidRequestError,
    OutOfSpaceError,
    ServiceError,
    UnavailableError,
)

_OF_ENGINE: tuple[tuple[type[EngineError], type[ServiceError]], ...] = (
    (InvalidInputError, InvalidRequestError),
    (Cancelled, UnavailableError),
    (BackendUnavailableError, UnavailableError),
)


def without_folders(text: str, root: Path) -> str:
    """The ``text`` with paths relative to the folder that they are in: the service's ``root``, or another.

    The others are those for temporary files, for files of this session, and of Python.
    """
    temporary = tempfile.gettempdir()
    others = (os.environ.get("XDG_RUNTIME_DIR") or temporary, temporary, sys.prefix, sys.base_prefix)
    for folder in (root.resolve(), root.absolute(), *map(Path, others)):
        text = text.replace(f"{folder}/", "").replace(str(folder), folder.name)
    return text


def from_engine(error: EngineError, root: Path) -> ServiceError:
    """The service's error for one of the engine's; paths are relative to the service's ``root``."""
    message, hint = without_folders(error.message, root), without_folders(error.hint, root)
    if error.code == "disk-full":
        return OutOfSpaceError("The disk is full.")
    for kind, service_kind in _OF_ENGINE:
        if isinstance(error, kind):
            return service_kind(message, hint=hint)
    return InternalError(message, hint=hint)
