"""JSON files that users give."""

import json
from pathlib import Path
from typing import Any

from fvs_engine.errors import InvalidInputError


def read_json(file: Path) -> Any:
    """The document in ``file``; raises ``InvalidInputError``, naming the file, when there is none."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidInputError(
            f"{file} cannot be read: {error.strerror}.", hint="Check the path.", path=file
        ) from error
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(
            f"{file} is not JSON: {error}.", hint="Export it again.", path=file
        ) from error
