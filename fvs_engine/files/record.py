"""Records as JSON files."""

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from fvs_engine.errors import StorageError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.records import Record, first_error

RecordT = TypeVar("RecordT", bound=Record)


def write_record(path: Path, record: Record) -> None:
    """Replace ``path`` by a record as JSON, whole or not at all; raises ``StorageError``."""
    write_text_atomically(path, record.model_dump_json(indent=1) + "\n")


def read_record(
    path: Path, kind: type[RecordT], remedy: str = "Choose another output folder."
) -> RecordT | None:
    """The record that ``write_record`` wrote; None when there is no file.

    Raises ``StorageError`` with the ``remedy`` when the file cannot be read, is damaged, or was written by
    another version.
    """
    try:
        return kind.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise StorageError(
            f"{path} cannot be read: {error.strerror or error}.", hint=remedy, path=path
        ) from error
    except ValidationError as error:
        raise StorageError(
            f"{path} cannot be used: {first_error(error)}.",
            hint=f"It is damaged or of another version of fvs. {remedy}",
            path=path,
        ) from error
