"""The files of a snapshot: their names, and where they are. Nothing here needs the database."""

import json

from fvs_service.errors import NotFoundError
from fvs_service.storage.blob_keys import artifact_key, manifest_key
from fvs_service.storage.blobs import Blobs

CAMERAS = "cameras.json"
"""The artifact with the ``SnapshotCameras``; every snapshot has it."""
GAUSSIANS = "point_cloud.ply"
"""The artifact with the Gaussians in the layout of 3DGS; every snapshot has it."""
COMPRESSED = "point_cloud.spz"
"""The artifact with the same Gaussians in a tenth of the bytes, rounded; for viewers."""
METRICS = "metrics.json"
"""The artifact with the snapshot's ``SnapshotMetrics``."""
COLMAP = "colmap.zip"
"""The artifact with COLMAP's binary model of the same cameras and points."""
ALIGNMENT = "alignment.json"
"""The artifact with the snapshot's ``Alignment``."""

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
