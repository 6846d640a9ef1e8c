"""Snapshots."""

from fvs_client.models.tables import ReprArgs
from fvs_schema.snapshots import Snapshot


class SnapshotData(Snapshot):
    """An immutable model: its metrics, alignment and artifacts."""

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("kind", self.kind.value))
        yield from (("registered", self.metrics.registered), ("gaussians", self.metrics.gaussians))
