"""Scenes, jobs and snapshots with what they show of themselves."""

from fvs_client.models.display import ReprArgs, facts_html
from fvs_schema.jobs import Job
from fvs_schema.scenes import Scene
from fvs_schema.snapshots import Snapshot


class SceneData(Scene):
    """A scene (one capture): its settings, image counts and latest snapshot."""

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("name", self.name), ("images", self.image_counts.received))
        yield "snapshot_id", self.snapshot_id

    def _repr_html_(self) -> str:
        counts = self.image_counts
        images = f"{counts.received} received, {counts.accepted} accepted, {counts.pending} pending"
        facts = {"id": self.id, "images": images, "world": world_text(self)}
        facts |= {"model": self.snapshot_id or "none yet", "created": f"{self.created_at:%F %H:%M}"}
        return facts_html(f"Scene {self.name}", facts.items())


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


class SnapshotData(Snapshot):
    """An immutable model: its metrics, alignment and artifacts."""

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("kind", self.kind.value))
        yield from (("registered", self.metrics.registered), ("gaussians", self.metrics.gaussians))


def world_text(scene: SceneData) -> str:
    """The world of a scene, and how well its model is aligned with it."""
    alignment = scene.alignment
    origin = scene.origin
    enu = f"ENU about {origin.latitude_deg:.6f}, {origin.longitude_deg:.6f}; " if origin is not None else ""
    if alignment is None:
        return f"{enu}{scene.world.kind}, no model to align yet"
    rms = (
        "" if alignment.rms_m is None else f", RMS {alignment.rms_m:.3f} m over {alignment.inliers} positions"
    )
    return f"{enu}{alignment.status.value}{rms}"
