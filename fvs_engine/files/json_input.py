"""Text files that users give, most of them JSON."""

import json
from pathlib import Path
from typing import Any

from fvs_engine.errors import InvalidInputError
from fvs_schema.text_files import decoded_text


def read_text(file: Path, hint: str = "Check the path.") -> str:
    """The text in ``file``; raises ``InvalidInputError``, naming the file, when there is none."""
    try:
        return decoded_text(file.read_bytes())
    except OSError as error:
        raise InvalidInputError(f"{file} cannot be read: {error.strerror}.", hint=hint, path=file) from error
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{file} is not a text file.", hint=hint, path=file) from error


def read_json(file: Path) -> Any:
    """The document in ``file``; raises ``InvalidInputError``, naming the file, when there is none."""
    try:
        return json.loads(read_text(file))
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(
            f"{file} is not JSON: {error}.", hint="Export it again.", path=file
        ) from error
