"""Requests for renders of a snapshot at any pose."""

from enum import StrEnum
from typing import Annotated

from pydantic import ConfigDict, Field

from fvs_schema.base import Input
from fvs_schema.poses import Pose
from fvs_schema.quantities import WHOLE


class ViewImage(StrEnum):
    """An image that can be made of a view."""

    RENDER = "render"
    SPECTRUM = "spectrum"


class RenderFormat(StrEnum):
    """The format of a render's file."""

    PNG = "png"
    """Without loss."""
    JPEG = "jpeg"
    """With a loss that is hard to see, in a fraction of the bytes: for a view that moves."""

    @property
    def media_type(self) -> str:
        """Its media type."""
        return f"image/{self.value}"


class RenderRequest(Input):
    """An image of a snapshot's model at a pose, by the usual camera of its images."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "pose": {
                        "frame": "model",
                        "position": [0.0, 0.0, -3.0],
                        "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
                    },
                    "long_side_px": 320,
                    "format": "jpeg",
                }
            ]
        }
    )

    pose: Pose
    """The camera's pose."""
    image: ViewImage = ViewImage.RENDER
    """Which image of the view."""
    long_side_px: Annotated[int, Field(strict=True, ge=64, le=4096), WHOLE] | None = None
    """The longer side of the image; by default that of `camera` in `cameras.json`, as of rankings."""
    format: RenderFormat = RenderFormat.PNG
    """The format of the file."""
