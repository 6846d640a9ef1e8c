"""Streams of bytes that never change."""

from collections.abc import AsyncIterator, Callable, Iterator
from typing import Protocol

from anyio.to_thread import run_sync
from fvs.v1.downloads_pb2 import DownloadInfo, DownloadPart

from fvs_service.errors import RangeError

_CHUNK_BYTES = 1_048_576
"""Maximum size of the bytes in one message; clients accept 4 MB by default."""


class _Ranged(Protocol):
    start: int
    stop: int

    def HasField(self, name: str, /) -> bool: ...  # noqa: N802


async def download(
    request: _Ranged,
    media_type: str,
    size_bytes: int,
    sha256: str,
    content: Callable[[int, int], Iterator[bytes]],
) -> AsyncIterator[DownloadPart]:
    """The description of the download, then the bytes from ``request.start`` up to ``request.stop``.

    Raises ``RangeError`` for a range that is empty or begins outside of the bytes.
    """
    start = request.start
    stop = min(request.stop, size_bytes) if request.HasField("stop") else size_bytes
    if start < 0 or (start >= stop and size_bytes > 0):
        raise RangeError(size_bytes)
    yield DownloadPart(
        info=DownloadInfo(media_type=media_type, size_bytes=size_bytes, sha256=sha256, start=start, stop=stop)
    )
    chunks = await run_sync(content, start, stop)
    while (chunk := await run_sync(next, chunks, None)) is not None:
        for begin in range(0, len(chunk), _CHUNK_BYTES):
            yield DownloadPart(chunk=bytes(chunk[begin : begin + _CHUNK_BYTES]))
