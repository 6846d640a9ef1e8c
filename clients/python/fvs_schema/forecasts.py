"""Forecasts: what a model does not know, at poses and over its surface."""

from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from fvs_schema.base import Input, Output
from fvs_schema.candidates import Candidate, CandidatesRequest, PlanGenerator
from fvs_schema.checks import of_fields, require_different, within
from fvs_schema.poses import Pose, PoseFrame
from fvs_schema.quantities import WHOLE, Number, Triple
from fvs_schema.scenes import Alignment, AltitudeDatum, Origin


class Surface(Input):
    """Places of the surface, spread evenly over the sparse points."""

    count: Annotated[int, Field(strict=True, ge=1, le=20_000), WHOLE] = 5_000
    """How many places, at most."""


class ForecastRequest(CandidatesRequest):
    """What to forecast: `candidates`, those of a `generator`, or the `surface`; by default an orbit."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"generator": {"kind": "grid", "columns": 40, "rows": 40, "margin_m": 10.0, "look": "down"}},
                {"surface": {"count": 5000}},
                {
                    "generator": {"kind": "orbit", "count": 48},
                    "after": [
                        {
                            "id": "north",
                            "pose": {
                                "frame": "world",
                                "position": [0.0, 0.0, -3.0],
                                "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
                            },
                        }
                    ],
                },
            ],
        }
    )

    generator: PlanGenerator | None = None
    """A rule that makes the candidates."""
    surface: Surface | None = None
    """The surface of the model, in place of candidates."""
    after: Annotated[tuple[Candidate, ...], Field(fail_fast=True), within("candidates_per_ranking")] = ()
    """Views that count as photographed, such as the stops of a plan."""
    frame: PoseFrame | None = None
    """The frame of the poses and positions in the answer; by default as in a ranking."""
    snapshot_id: str | None = None
    """The snapshot to forecast for; by default the newest."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for name in ("candidates", "generator"):
            if self.surface is not None and getattr(self, name) is not None:
                raise of_fields("give either candidates, a generator or the surface", "surface", name)
        require_different((candidate.id for candidate in self.candidates or ()), "candidates")
        return self

    @property
    def complete(self) -> Self:
        """The same request with a generator, where it has none of the three."""
        return self if self.surface is not None else super().complete


class FramePosition(Output):
    """A position in the world or the model frame."""

    frame: PoseFrame
    """The frame of the position."""
    position: Triple
    """x, y, z."""


class GeodeticPosition(Output):
    """A position on Earth."""

    latitude_deg: Number
    """Geodetic latitude on WGS 84, north positive."""
    longitude_deg: Number
    """Longitude, east positive."""
    altitude_m: Number
    """Altitude above `altitude_datum`."""
    altitude_datum: AltitudeDatum
    """The datum of the scene's altitudes."""


class ForecastSample(Output):
    """How little is known of a view: at a candidate's `pose`, or of a place of the surface at `position`."""

    id: str
    """The candidate's id; `surface-…` for a place of the surface."""
    pose: Pose | None = None
    """The candidate's pose; null for a place of the surface."""
    position: FramePosition | GeodeticPosition | None = None
    """Where the place of the surface is; null for a candidate."""
    variance: Number
    """The kriging variance, from 1 where no image is near to 0 among very many. Of a place it is that of a
    view from the mean direction and the mean distance of the images that see it."""
    psnr_db: Number | None
    """The PSNR to expect of a render of that view; null unless the forecast is `calibrated`."""
    low_db: Number | None
    """With `high_db`: an interval that holds the PSNR of the view in four of five cases."""
    high_db: Number | None
    """The upper end of that interval."""


class Forecast(Output):
    """What is known of poses, or of the surface; it is not stored."""

    scene_id: str
    """The scene."""
    snapshot_id: str
    """The snapshot that it is made for."""
    calibrated: bool
    """Whether three updates have measured their new images, so that samples have a PSNR."""
    samples: tuple[ForecastSample, ...]
    """One per candidate, in their order, or per place of the surface."""
    alignment: Alignment
    """The alignment of the model with the world."""
    origin: Origin | None = None
    """The ENU origin that geodetic poses refer to; null in scenes that are not georeferenced."""
