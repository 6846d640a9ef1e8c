"""Scenes."""

from fvs_client.models.tables import ReprArgs, facts_html
from fvs_schema.scenes import Scene


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
