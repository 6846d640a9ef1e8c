"""The files of the page, as ``clients/web`` builds them, compressed once."""

import gzip
from functools import cache
from pathlib import Path
from typing import NamedTuple

_FOLDER = Path(__file__).with_name("built")
_INDEX = "index.html"
_MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


class BuiltFile(NamedTuple):
    """One file: its bytes, the same compressed by gzip, and its media type."""

    content: bytes
    compressed: bytes
    media_type: str


def built_file(name: str) -> BuiltFile | None:
    """The file with a name of the build's folder ``assets``; None when there is none."""
    return _read(_FOLDER / "assets" / name) if name in _names() else None


def index_page() -> BuiltFile:
    """The page itself."""
    return _read(_FOLDER / _INDEX)


@cache
def _names() -> frozenset[str]:
    return frozenset(path.name for path in (_FOLDER / "assets").iterdir())


@cache  # of files that exist: anybody can ask for any number of names
def _read(path: Path) -> BuiltFile:
    content = path.read_bytes()
    return BuiltFile(content, gzip.compress(content, mtime=0), _MEDIA_TYPES[path.suffix])
