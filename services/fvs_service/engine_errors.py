"""Messages of the engine and of libraries, for clients: without the folders of this machine."""

import os
import sys
import tempfile
from pathlib import Path

from fvs_engine.errors import (
    BackendUnavailableError,
    Cancelled,
    DeviceMemoryError,
    EngineError,
    InvalidInputError,
)
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
    (DeviceMemoryError, UnavailableError),
)


def without_folders(text: str, root: Path) -> str:
    """The ``text`` with paths relative to the folder that they are in: the service's ``root``, or another.

    The others are those for temporary files, for files of this session, and of Python.
    """
    temporary = tempfile.gettempdir()
    others = (os.environ.get("XDG_RUNTIME_DIR") or temporary, temporary, sys.prefix, sys.base_prefix)
    folders = {root.resolve(), root.absolute(), *map(Path, others)}
    for folder in sorted(folders, key=lambda each: len(each.parts), reverse=True):  # the inner ones first
        text = text.replace(f"{folder}/", "").replace(str(folder), folder.name)
    return text


def for_clients(error: EngineError | ServiceError, root: Path) -> tuple[str, str]:
    """The message and the hint, with the name of the file that the error is about in place of its path.

    Other paths are relative to the service's ``root``.
    """
    message, hint = error.message, error.hint
    if isinstance(error, EngineError) and error.path is not None:
        path, name = str(error.path), Path(error.path).name
        message, hint = message.replace(path, name), hint.replace(path, name)
    return without_folders(message, root), without_folders(hint, root)


def from_engine(error: EngineError, root: Path) -> ServiceError:
    """The service's error for one of the engine's, with the texts ``for_clients``."""
    message, hint = for_clients(error, root)
    if error.code == "disk-full":
        return OutOfSpaceError("The disk is full.")
    for kind, service_kind in _OF_ENGINE:
        if isinstance(error, kind):
            return service_kind(message, hint=hint)
    return InternalError(message, hint=hint)
