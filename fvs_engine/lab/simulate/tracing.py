"""Ray casting: the light that reaches each pixel."""

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import inlined_kernel, parallel_kernel
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.cameras import Camera
from fvs_engine.lab.simulate.world import World

Array = NDArray[np.float64]

RAYS_PER_SIDE = 3
"""Rays per pixel and direction: enough that distant textures do not alias."""

_SHARE = 1.0 / RAYS_PER_SIDE**2
_NEAREST = 1e-6
_SKY, _NOTHING, _SEVERAL = -1, -2, -3


class PackedWorld:
    """The world as the kernel reads it: planes [N, ...] and all textures in one array."""

    def __init__(self, world: World) -> None:
        rectangles = world.rectangles
        self.corners = np.stack([r.corner for r in rectangles])
        self.sides = np.stack([np.stack([r.side_u, r.side_v]) for r in rectangles])
        self.duals = self.sides / (self.sides**2).sum(axis=-1, keepdims=True)
        normals = np.cross(self.sides[:, 0], self.sides[:, 1])
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self.shapes = np.array([r.texture.shape[:2] for r in rectangles], dtype=np.int64)
        sizes = self.shapes.prod(axis=1)
        self.offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
        self.texels = np.concatenate([r.texture.reshape(-1, 3) for r in rectangles])
        self.sky = 255.0 * np.array(world.sky)

    def in_front(self, corner_rays: Array, world_from_camera: RigidTransform) -> NDArray[np.int64]:
        """The rectangles that no side of the camera's pyramid of sight parts from it."""
        u, v = self.sides[:, 0], self.sides[:, 1]
        outline = np.stack([self.corners + a * u + b * v for a in (0, 1) for b in (0, 1)], axis=1)
        x, y, z = np.moveaxis(world_from_camera.inverse().apply(outline), -1, 0)
        (left, top), (right, bottom) = np.nanmin(corner_rays, (0, 1)), np.nanmax(corner_rays, (0, 1))
        beyond = np.stack([z < 0, x < left * z, x > right * z, y < top * z, y > bottom * z])
        return np.flatnonzero(~beyond.all(axis=-1).any(axis=0))


def pixel_corner_rays(camera: Camera) -> Array:
    """Points [H + 1, W + 1, 2] on the plane z = 1 behind the corners of the pixels, NaN where none comes."""
    grid = np.stack(np.meshgrid(np.arange(camera.width + 1.0), np.arange(camera.height + 1.0)), axis=-1)
    return np.ascontiguousarray(camera.unproject(grid)[..., :2])


def trace(world: PackedWorld, corner_rays: Array, world_from_camera: RigidTransform) -> Array:
    """The light [H, W, 3] in [0, 1] that reaches each pixel; black where the lens sees nothing."""
    rotation, origin = np.ascontiguousarray(world_from_camera.rotation), world_from_camera.translation
    seen = world.in_front(corner_rays, world_from_camera)
    planes = (world.corners[seen], world.duals[seen], world.normals[seen])
    textures = (world.shapes[seen], world.offsets[seen], world.texels)
    hits = _first_hits(corner_rays, rotation, origin, *planes)
    image = _shade(hits, corner_rays, rotation, origin, *planes, *textures, world.sky)
    return image / 255.0


@inlined_kernel
def _intersect(
    k: int, rotation: Array, origin: Array, x: float, y: float, corners: Array, duals: Array, normals: Array
) -> tuple[float, float, float]:
    """Where the ray (x, y, 1) meets rectangle ``k``: distance (inf: nowhere), u and v in [0, 1)."""
    dx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]
    dy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]
    dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
    cx, cy, cz = corners[k, 0] - origin[0], corners[k, 1] - origin[1], corners[k, 2] - origin[2]
    slope = normals[k, 0] * dx + normals[k, 1] * dy + normals[k, 2] * dz
    distance = (normals[k, 0] * cx + normals[k, 1] * cy + normals[k, 2] * cz) / slope
    px, py, pz = distance * dx - cx, distance * dy - cy, distance * dz - cz
    u = duals[k, 0, 0] * px + duals[k, 0, 1] * py + duals[k, 0, 2] * pz
    v = duals[k, 1, 0] * px + duals[k, 1, 1] * py + duals[k, 1, 2] * pz
    # A ray along the plane gives inf or nan, which fails every comparison.
    if not (distance > _NEAREST and 0.0 <= u < 1.0 and 0.0 <= v < 1.0):
        return np.inf, 0.0, 0.0
    return distance, u, v


@inlined_kernel
def _nearest(
    rotation: Array, origin: Array, x: float, y: float, corners: Array, duals: Array, normals: Array
) -> int:
    """The rectangle that the ray meets first, ``_SKY`` for none; ``_NOTHING`` where the lens has no ray."""
    if not (np.isfinite(x) and np.isfinite(y)):
        return _NOTHING
    nearest, hit = np.inf, _SKY
    for k in range(len(corners)):
        distance, _, _ = _intersect(k, rotation, origin, x, y, corners, duals, normals)
        if distance < nearest:
            nearest, hit = distance, k
    return hit


@parallel_kernel
def _first_hits(
    corner_rays: Array, rotation: Array, origin: Array, corners: Array, duals: Array, normals: Array
) -> NDArray[np.int32]:
    """What the ray behind each corner of a pixel meets, [H + 1, W + 1]."""
    height, width, _ = corner_rays.shape
    hits = np.empty((height, width), dtype=np.int32)
    for row in numba.prange(height):
        for column in range(width):
            x, y = corner_rays[row, column]
            hits[row, column] = _nearest(rotation, origin, x, y, corners, duals, normals)
    return hits


@parallel_kernel
def _shade(
    hits: NDArray[np.int32],
    corner_rays: Array,
    rotation: Array,
    origin: Array,
    corners: Array,
    duals: Array,
    normals: Array,
    shapes: NDArray[np.int64],
    offsets: NDArray[np.int64],
    texels: NDArray[np.uint8],
    sky: Array,
) -> Array:
    """The mean [H, W, 3] of the colours that a grid of rays per pixel meets."""
    height, width = len(hits) - 1, len(hits[0]) - 1
    image = np.zeros((height, width, 3))
    for row in numba.prange(height):
        for column in range(width):
            # Where all corners meet one surface, the rays between them meet it too.
            common = hits[row, column]
            if (
                hits[row, column + 1] != common
                or hits[row + 1, column] != common
                or hits[row + 1, column + 1] != common
            ):
                common = _SEVERAL
            for sample in range(RAYS_PER_SIDE * RAYS_PER_SIDE):
                # The lens is smooth: inside a pixel its rays follow from those at the corners.
                fy = (sample // RAYS_PER_SIDE + 0.5) / RAYS_PER_SIDE
                fx = (sample % RAYS_PER_SIDE + 0.5) / RAYS_PER_SIDE
                rays = corner_rays[row : row + 2, column : column + 2]
                x = (1 - fy) * ((1 - fx) * rays[0, 0, 0] + fx * rays[0, 1, 0]) + fy * (
                    (1 - fx) * rays[1, 0, 0] + fx * rays[1, 1, 0]
                )
                y = (1 - fy) * ((1 - fx) * rays[0, 0, 1] + fx * rays[0, 1, 1]) + fy * (
                    (1 - fx) * rays[1, 0, 1] + fx * rays[1, 1, 1]
                )
                hit = common
                if hit == _SEVERAL:
                    hit = _nearest(rotation, origin, x, y, corners, duals, normals)
                if hit == _NOTHING:
                    continue
                if hit == _SKY:
                    for c in range(3):
                        image[row, column, c] += _SHARE * sky[c]
                    continue
                _, u, v = _intersect(hit, rotation, origin, x, y, corners, duals, normals)
                # Bilinear between the centres of texels, held at the border.
                rows, columns = shapes[hit, 0], shapes[hit, 1]
                ty = min(max(v * rows - 0.5, 0.0), rows - 1.000001)
                tx = min(max(u * columns - 0.5, 0.0), columns - 1.000001)
                r0, c0 = int(ty), int(tx)
                wy, wx = ty - r0, tx - c0
                first = offsets[hit] + r0 * columns + c0
                for c in range(3):
                    above = (1 - wx) * texels[first, c] + wx * texels[first + 1, c]
                    below = (1 - wx) * texels[first + columns, c] + wx * texels[first + columns + 1, c]
                    image[row, column, c] += _SHARE * ((1 - wy) * above + wy * below)
    return image
