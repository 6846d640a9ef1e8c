"""Draw contact_sheet.png: a room of splats that is known well on one side and hardly on the other.

    python docs/images/contact_sheet.py

The room is simulated, so that the picture contains no photographs.
"""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.pipeline.contact_sheet import SheetEntry, contact_sheet
from fvs_engine.pipeline.render import render_color
from fvs_engine.score import Candidate, MedianFrequency, rank
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.spherical_harmonics import dc_from_color

VIEWS = 8
FINE, COARSE = 0.018, 0.16
"""Sizes of splats where the room is known and where it is not; the room is 8 wide and 4 high."""


def main() -> None:
    """Render views all around, rank them and draw the sheet."""
    rasterizer = create_rasterizer("cpu")
    gaussians = room(np.random.default_rng(0))
    camera = PinholeCamera(640, 427, 480.0, 480.0, 320.0, 213.5)
    angles = np.linspace(0, 2 * np.pi, VIEWS, endpoint=False) + 0.3
    candidates = {
        f"heading {np.degrees(angle):.0f}°": look_at(
            [0, 0, 0], [np.cos(angle), np.sin(angle), -0.35], [0, 0, 1]
        )
        for angle in angles
    }
    views = {name: Candidate(name, camera, placed.inverse()) for name, placed in candidates.items()}
    ranked = rank(MedianFrequency().score(gaussians, list(views.values()), rasterizer))
    entries = [SheetEntry(place, render_color(gaussians, views[place.id], rasterizer)) for place in ranked]
    path = Path(__file__).with_suffix(".png")
    contact_sheet(path, entries, title="Next views · a room known on one side")
    with Image.open(path) as sheet:
        small = sheet.resize((1200, round(1200 * sheet.height / sheet.width)), Image.Resampling.LANCZOS)
    small.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def room(generator: np.random.Generator) -> Gaussians:
    """Four walls and a floor of tiles and bricks, and balls; splats grow with x from -1 to 1."""
    points, normals = surfaces(generator, 900_000)
    knownness = np.clip(0.5 + 0.5 * points[:, 0], 0, 1)
    size = FINE * (COARSE / FINE) ** knownness
    kept = generator.uniform(size=len(points)) < (FINE / size) ** 2
    points, normals, size = points[kept], normals[kept], size[kept]
    colors = texture(points, normals)
    count = len(points)
    return Gaussians(
        means=_tensor(points),
        log_scales=_tensor(np.log(size)[:, None] + np.where(np.abs(normals) > 0.7, -2.0, 0.0)),
        quaternions_wxyz=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        opacity_logits=torch.full((count,), 2.5),
        sh_dc=dc_from_color(_tensor(colors)),
        sh_rest=torch.zeros(count, 0, 3),
    )


def surfaces(generator: np.random.Generator, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Random points [count, 3] on the room and their normals."""
    points = generator.uniform(-1, 1, (count, 3)) * [4, 4, 2]
    normals = np.zeros_like(points)
    side = generator.choice(6, size=count, p=[0.15, 0.15, 0.15, 0.15, 0.3, 0.1])
    for wall, (axis, place) in enumerate([(0, -4), (0, 4), (1, -4), (1, 4), (2, -2)]):
        points[side == wall, axis] = place
        normals[side == wall, axis] = 1
    ball = np.flatnonzero(side == 5)
    directions = generator.normal(size=(len(ball), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    which = generator.integers(0, 10, len(ball))
    around = 2 * np.pi * np.arange(10) / 10
    centres = np.stack([2.6 * np.cos(around), 2.6 * np.sin(around), np.full(10, -1.5)], axis=1)
    points[ball] = centres[which] + 0.5 * directions
    normals[ball] = directions * (np.abs(directions) > 0.9)
    return points, normals


def texture(points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colours [N, 3]: bricks on walls, tiles on the floor, stripes on balls."""
    x, y, z = points.T
    along = np.where(np.abs(normals[:, 0]) == 1, y, x)
    row = np.floor(z / 0.2)
    column = (along + 0.25 * (row % 2)) / 0.5
    joint = (np.abs(z / 0.2 - row - 0.5) > 0.43) | (np.abs(column - np.floor(column) - 0.5) > 0.47)
    shade = 0.75 + 0.25 * np.sin(12.9898 * np.floor(column) + 78.233 * row) ** 2
    brick = np.where(joint[:, None], [0.8, 0.78, 0.74], shade[:, None] * [0.72, 0.36, 0.26])
    odd = (np.floor(x / 0.4) + np.floor(y / 0.4)) % 2
    tile = np.where(odd[:, None] == 1, [0.85, 0.84, 0.8], [0.24, 0.3, 0.36])
    stripe = np.where(np.sin(26 * z)[:, None] > 0, [0.95, 0.75, 0.25], [0.15, 0.35, 0.6])
    floor, wall = np.abs(normals[:, 2]) == 1, np.abs(normals[:, :2]).max(axis=1) == 1
    return np.where(floor[:, None], tile, np.where(wall[:, None], brick, stripe))


def _tensor(values: NDArray[np.float64]) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))


if __name__ == "__main__":
    main()
