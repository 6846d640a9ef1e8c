"""Text files that users give, most of them JSON."""

import codecs
import json
from pathlib import Path
from typing import Any

from fvs_engine.errors import InvalidInputError

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""Byte order marks, which editors and PowerShell on Windows write, and the encodings after them."""


def decoded_text(content: bytes) -> str:
    """The text of a file: UTF-8, or what its byte order mark says, which is left out.

    Raises ``UnicodeDecodeError``.
    """
    encoding = next((name for mark, name in _MARKS.items() if content.startswith(mark)), "utf-8")
    return content.decode(encoding)


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
