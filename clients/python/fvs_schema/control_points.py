"""Control and check points: what was surveyed and marked, and how well a model fits it."""

from typing import Annotated

from pydantic import ConfigDict, Field, model_validator

from fvs_schema.base import Input, Output
from fvs_schema.checks import of_fields, repeated, within
from fvs_schema.quantities import MAX_SIDE_PX, Coordinate, Count, Number
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.words import Word

PointName = Annotated[str, Field(min_length=1, max_length=128, pattern=r"^[^\x00-\x1f\x7f]+$")]
_Pixel = Annotated[Number, Field(ge=0, le=MAX_SIDE_PX)]


class Mark(Input):
    """Where an image shows a point, in px of the stored pixels: EXIF's orientation does not turn them.

    The top left corner of the top left pixel is (0, 0).
    """

    image: Annotated[str, Field(min_length=1, max_length=4096)]
    """The image, by its digest or by its name, if only one has it."""
    x_px: _Pixel
    """To the right."""
    y_px: _Pixel
    """Down."""


class ControlPoint(Input):
    """A surveyed point and its marks; two of them or more measure it in the model."""

    name: PointName
    """The name, which no other point has."""
    x: Coordinate
    """The easting, or the longitude in degrees."""
    y: Coordinate
    """The northing, or the latitude in degrees."""
    z: Coordinate | None = None
    """The height in metres; without one the point only checks the horizontal position."""
    check: bool = False
    """Whether it is a check point: measured, and not used for the alignment."""
    marks: Annotated[tuple[Mark, ...], Field(fail_fast=True), within(1_000)] = ()
    """Where images show it, each once."""

    @model_validator(mode="after")
    def _marked_once(self) -> "ControlPoint":
        twice = repeated(mark.image for mark in self.marks)
        if twice is not None:
            raise of_fields(f"{self.name} has two marks in {twice}", "marks")
        return self


class ControlPoints(Input):
    """The control and check points of a scene."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "crs": "EPSG:25832",
                    "points": [
                        {
                            "name": "G1",
                            "x": 537653.198,
                            "y": 5260847.354,
                            "z": 410.1,
                            "marks": [
                                {"image": "DJI_0021.JPG", "x_px": 1102.7, "y_px": 2208.0},
                                {"image": "DJI_0022.JPG", "x_px": 1195.7, "y_px": 2183.1},
                            ],
                        }
                    ],
                }
            ]
        }
    )

    crs: Annotated[str, Field(min_length=1, max_length=1000)]
    """The CRS of x and y: `EPSG:25832`, `WGS84 UTM 32N`, or a PROJ string."""
    altitude_datum: AltitudeDatum | None = None
    """What heights are measured from; by default as the CRS says, and above sea level where it does not."""
    points: Annotated[tuple[ControlPoint, ...], Field(min_length=1, fail_fast=True), within(1_000)]
    """The points."""

    @model_validator(mode="after")
    def _different_names(self) -> "ControlPoints":
        twice = repeated(point.name for point in self.points)
        if twice is not None:
            raise of_fields(f"two points have the name {twice}", "points")
        return self


class PointStatus(Word):
    """What became of a point."""

    USED = "used"
    """The alignment is from it and the other used ones."""
    CHECK = "check"
    """It is measured, and not used."""
    OUTLIER = "outlier"
    """It is a control point that contradicts the others, and is not used."""
    NO_HEIGHT = "no-height"
    """It has no height: only its horizontal position is checked."""
    SEEN_ONCE = "seen-once"
    """Fewer than two registered images have a mark of it."""
    NO_PARALLAX = "no-parallax"
    """The images with a mark of it are side by side: they leave its depth open."""
    MARKS_DISAGREE = "marks-disagree"
    """No point projects to where most of its marks are."""


class PointResidual(Output):
    """How far a point of the aligned model is from its surveyed position."""

    name: str
    """The name of the point."""
    check: bool
    """Whether it is a check point."""
    status: PointStatus
    """What became of it."""
    east_m: Number | None = None
    """Model minus survey, to the east; null where the point is not measured."""
    north_m: Number | None = None
    """The same to the north."""
    up_m: Number | None = None
    """The same upwards; null as well where the point has no height."""
    distance_m: Number | None = None
    """The length of the three, or of the first two."""
    marks: Count
    """Its marks in registered images."""
    wrong_marks: tuple[str, ...] = ()
    """The images whose marks contradict the others; they are not used."""
    reprojection_px: Number | None = None
    """The root mean square of the distances between the other marks and the measured point's projections."""


class ControlResiduals(Output):
    """How well the model fits the points that were measured."""

    points: tuple[PointResidual, ...]
    """The points, in the order in which they were given."""
    control_rms_m: Number
    """Root mean square of the distances of the used control points."""
    check_rms_m: Number | None
    """The same of the check points with a height; null without one."""
