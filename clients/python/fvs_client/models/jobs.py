"""Jobs."""

from fvs_client.models.tables import ReprArgs
from fvs_schema.jobs import Job


class JobData(Job):
    """A job and its progress."""

    @property
    def ended(self) -> bool:
        """Whether the job has succeeded, failed or been canceled."""
        return self.state.ended

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("kind", self.kind.value))
        yield from (("state", self.state.value), ("progress", self.progress))
        yield "snapshot_id", self.snapshot_id
