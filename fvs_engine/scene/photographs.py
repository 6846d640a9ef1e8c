"""Training images: undistorted, at the training size."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import Camera, PinholeCamera, RigidTransform
from fvs_engine.images.masks import Mask, read_mask, reduced_mask
from fvs_engine.images.pixels import load_rgb, reduced_size
from fvs_engine.monitor import Monitor
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import AnyView
from fvs_schema.stages import Stage

Array = NDArray[np.float64]

MAX_SHIFT_PX = 0.1
"""Pixel shift at the training size below which two cameras give the same undistorted image."""

_MAPS_KEPT = 4
"""Number of cached maps: each takes the memory of three images; global bundle adjustment needs new ones."""

_ALL = 0.999
"""Share of a pixel, up to rounding, that must count for it to count."""

_ZOOMS = (0.5, 4.0)
_ZOOM_STEPS = 30


class Photographs:
    """Loads the images of a folder as pinhole images of ``long_side_px``.

    The maps from pinhole pixels to photographs of the cameras used last are kept: views that share a camera
    share one.
    """

    def __init__(self, image_dir: Path, long_side_px: int) -> None:
        self._image_dir = image_dir
        self._long_side_px = long_side_px
        self._pinholes: dict[Camera, PinholeCamera] = {}
        self._maps: dict[Camera, Tensor] = {}

    def pinhole(self, camera: Camera) -> PinholeCamera:
        """The camera, at the training size, of the photographs that ``camera`` took.

        It has the same pose, no distortion, and the widest field of view without empty pixels.
        Raises ``InvalidInputError`` when no plausible zoom has none.
        """
        if camera not in self._pinholes:
            size = reduced_size(camera.width, camera.height, self._long_side_px)
            self._pinholes[camera] = (
                camera.resized(*size) if isinstance(camera, PinholeCamera) else _filled(camera, size)
            )
        return self._pinholes[camera]

    def load(self, name: str, camera: Camera, camera_from_model: RigidTransform) -> TrainingView:
        """Load an image. Raises ``InvalidInputError`` when its size is not its camera's."""
        pinhole = self.pinhole(camera)
        image, mask = load_rgb(self._image_dir / name, self._long_side_px), read_mask(self._image_dir, name)
        if image.shape[:2] != (pinhole.height, pinhole.width):
            raise InvalidInputError(
                f"{self._image_dir / name} becomes {image.shape[1]}×{image.shape[0]} px, "
                f"its camera {pinhole.width}×{pinhole.height} px.",
                hint="Give the images that the cameras were computed from.",
                path=self._image_dir / name,
            )
        if mask is not None and mask.shape != image.shape[:2]:
            mask = reduced_mask(mask, (pinhole.width, pinhole.height))
        if not isinstance(camera, PinholeCamera):
            where = self._map(camera, pinhole)
            image = _resampled(image, where)
            mask = None if mask is None else _resampled_mask(mask, where)
        return TrainingView(name, pinhole, camera_from_model, image, mask)

    def load_all(self, views: Sequence[AnyView], monitor: Monitor) -> list[TrainingView]:
        """Load the images of ``views``. Stage ``load``; raises ``Cancelled`` and as ``load``."""
        loaded = []
        for done, view in enumerate(views, start=1):
            monitor.check()
            loaded.append(self.load(view.name, view.camera, view.camera_from_model))
            monitor.report(Stage.LOAD, done, len(views))
        return loaded

    def _map(self, camera: Camera, pinhole: PinholeCamera) -> Tensor:
        """Where the pixels of the pinhole image lie in the photograph, [1, H, W, 2], from -1 to 1 each."""
        where = self._maps.pop(camera, None)
        if where is None:
            pixels = _source_pixels(camera, pinhole, _grid(pinhole))
            shares = 2.0 * pixels / np.array([pinhole.width, pinhole.height]) - 1.0
            where = torch.from_numpy(shares.astype(np.float32))[None]
        self._maps[camera] = where  # most recently used last
        if len(self._maps) > _MAPS_KEPT:
            del self._maps[next(iter(self._maps))]
        return where

    def same_image(self, first: Camera, second: Camera) -> bool:
        """Whether an image is the same by either camera: no pixel moves by ``MAX_SHIFT_PX``."""
        if first == second:
            return True
        if (first.width, first.height) != (second.width, second.height):
            return False
        old, new = self.pinhole(first), self.pinhole(second)
        border = _border(old)
        rays = old.unproject(border)
        shift = np.abs(new.project(rays) - border).max()
        bent = np.abs(_source_pixels(second, new, border) - _source_pixels(first, old, border)).max()
        return bool(max(shift, bent) < MAX_SHIFT_PX)


def _filled(camera: Camera, size: tuple[int, int]) -> PinholeCamera:
    """The widest pinhole camera of ``size`` whose pixels are all in the photograph."""
    low, high = _ZOOMS
    if not _is_filled(camera, _zoomed(camera, size, high)):
        raise InvalidInputError(
            f"No pinhole view fits into the images of the {camera.width}×{camera.height} px camera.",
            hint="Its distortion is wrong, or far too strong: undistort the images first.",
        )
    for _ in range(_ZOOM_STEPS):
        middle = 0.5 * (low + high)
        if _is_filled(camera, _zoomed(camera, size, middle)):
            high = middle
        else:
            low = middle
    return _zoomed(camera, size, high)


def _zoomed(camera: Camera, size: tuple[int, int], zoom: float) -> PinholeCamera:
    plain = PinholeCamera(
        camera.width, camera.height, zoom * camera.fx, zoom * camera.fy, camera.cx, camera.cy
    )
    return plain.resized(*size)


def _is_filled(camera: Camera, pinhole: PinholeCamera) -> bool:
    where = _source_pixels(camera, pinhole, _border(pinhole))
    inside = (where >= 0) & (where <= np.array([pinhole.width, pinhole.height]))
    return bool(inside.all())


def _border(pinhole: PinholeCamera) -> Array:
    """Pixels [B, 2] along the outline of the image."""
    x = np.arange(pinhole.width) + 0.5
    y = np.arange(pinhole.height) + 0.5
    sides = [(x, np.full_like(x, value)) for value in (y[0], y[-1])]
    sides += [(np.full_like(y, value), y) for value in (x[0], x[-1])]
    return np.concatenate([np.stack(side, axis=-1) for side in sides])


def _grid(pinhole: PinholeCamera) -> Array:
    y, x = np.mgrid[: pinhole.height, : pinhole.width] + 0.5
    return np.stack([x, y], axis=-1)


def _source_pixels(camera: Camera, pinhole: PinholeCamera, pixels: Array) -> Array:
    """Where ``pixels`` [..., 2] of the pinhole image lie in the photograph reduced to the same size."""
    scale = np.array([pinhole.width / camera.width, pinhole.height / camera.height])
    return np.asarray(camera.project(pinhole.unproject(pixels)) * scale)


def _resampled(image: NDArray[np.uint8], where: Tensor) -> NDArray[np.uint8]:
    """The image [H, W, 3] at ``where`` (see ``Photographs._map``).

    By cubic convolution: bilinear weights would blur the reduced photograph again, and a spline of the same
    degree takes six times as long.
    """
    channels = torch.from_numpy(image).permute(2, 0, 1)[None].to(torch.float32)
    found = grid_sample(channels, where, mode="bicubic", padding_mode="border", align_corners=False)[0]
    return found.round_().clamp_(0, 255).to(torch.uint8).permute(1, 2, 0).contiguous().numpy()


def _resampled_mask(mask: Mask, where: Tensor) -> Mask:
    """The mask [H, W] at ``where``: a pixel counts where all do that it lies between."""
    shares = torch.from_numpy(mask)[None, None].to(torch.float32)
    found = grid_sample(shares, where, mode="bilinear", padding_mode="border", align_corners=False)
    return np.asarray(found[0, 0] > _ALL)
