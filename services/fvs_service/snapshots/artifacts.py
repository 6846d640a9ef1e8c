"""The files of a snapshot: their types, and where they are. Nothing here needs the database."""

import json

from fvs_service.errors import NotFoundError
from fvs_service.storage.blob_keys import artifact_key, manifest_key
from fvs_service.storage.blobs import Blobs

MEDIA_TYPES = {
    ".ply": "application/ply",
    ".spz": "application/octet-stream",
    ".json": "application/json",
    ".zip": "application/zip",
    ".safetensors": "application/octet-stream",
}
"""By the ending of an artifact's name."""


def find_artifact(blobs: Blobs, scene_id: str, snapshot_id: str, name: str) -> str:
    """The blob key of an artifact, for runners, which do not read the database; raises ``NotFoundError``."""
    digests = json.loads(blobs.read(manifest_key(scene_id, snapshot_id)))
    if name not in digests:
        raise NotFoundError("The snapshot has no such artifact.")
    return artifact_key(scene_id, digests[name])
