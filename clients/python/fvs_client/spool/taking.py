"""Take photographs into the outbox."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from fvs_client.spool.folder import FoundFile
from fvs_client.spool.metadata import Describe, merged, read_sidecar
from fvs_client.spool.outbox import Outbox
from fvs_client.spool.photograph import NewPhotograph, Photograph, Refusal

UNSUPPORTED = "unsupported-format"
"""The code of a file in a format that the service does not read."""
_READ_BYTES = 1 << 18


def take(
    outbox: Outbox,
    file: FoundFile,
    scene: str,
    describe: Describe | None = None,
    *,
    refusal: Refusal | None = None,
    durable: bool = True,
) -> Photograph:
    """Add a file with its digest and metadata to the outbox. Raises ``OSError`` when it cannot be read.

    With a ``refusal`` it is kept there, and not sent. Who looks at the file again after a power cut needs not
    wait until the addition is ``durable``.
    """
    metadata, unusable = _known_of(file, describe)
    refusal = refusal or unusable
    if not file.readable:
        kind = file.path.suffix[1:].upper()
        refusal = Refusal(
            UNSUPPORTED, f"The service does not read {kind} files.", "Export it as JPEG or PNG."
        )
    return outbox.add(
        NewPhotograph(
            path=file.path,
            scene=scene,
            name=str(metadata.get("name", file.name)),
            digest=digest_of(file.path),
            size_bytes=file.size_bytes,
            mtime_ns=file.mtime_ns,
            sidecar=file.sidecar_state,
            metadata={name: value for name, value in metadata.items() if name != "name"},
            refusal=refusal,
        ),
        durable=durable,
    )


def digest_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal. Raises ``OSError``."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_READ_BYTES):
            digest.update(block)
    return digest.hexdigest()


def _known_of(file: FoundFile, describe: Describe | None) -> tuple[Mapping[str, object], Refusal | None]:
    read = None if file.sidecar is None else read_sidecar(Path(file.sidecar))
    if isinstance(read, Refusal):
        return {}, read
    return merged(read, None if describe is None else describe(file.path)), None
