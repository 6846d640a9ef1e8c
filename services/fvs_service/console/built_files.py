"""The files of the page, as ``clients/web`` builds and compresses them."""

import gzip
from functools import cache
from pathlib import Path
from typing import NamedTuple

_FOLDER = Path(__file__).with_name("built")
_MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".wasm": "application/wasm",
}


class BuiltFile(NamedTuple):
    """One file: its bytes, compressed by gzip, and its media type."""

    compressed: bytes
    media_type: str

    @property
    def content(self) -> bytes:
        """Its bytes."""
        return gzip.decompress(self.compressed)


def built_file(name: str) -> BuiltFile | None:
    """The file with a name of the build's folder ``assets``; None when there is none."""
    return _read(f"assets/{name}") if name in _names() else None


def index_page() -> BuiltFile:
    """The page itself."""
    return _read("index.html")


@cache
def _names() -> frozenset[str]:
    return frozenset(path.stem for path in (_FOLDER / "assets").iterdir())


@cache  # of files that exist: anybody can ask for any number of names
def _read(name: str) -> BuiltFile:
    path = _FOLDER / f"{name}.gz"
    return BuiltFile(path.read_bytes(), _MEDIA_TYPES[Path(name).suffix])
