"""Text files that users give, in the encodings that editors write."""

import codecs

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
