"""Lists of tiles: complete, front to back, without hits that the ellipse misses, never beyond their room."""

import math
from itertools import pairwise

import pytest
import torch
from projected_splats import DEVICE, project_scenes, projected
from raster_scenes import FOR_THE_INTERPRETER, SMALL_CAMERA, build_few

from fvs_engine.errors import DeviceMemoryError
from fvs_engine.splat.conventions import (
    ALPHA_MIN,
    CENTER_X,
    CENTER_Y,
    DEPTH,
    EXTENT_X,
    EXTENT_Y,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    HEIGHT,
    OPACITY,
    RECORD_SIZE,
    SLOPE_X,
    SLOPE_Y,
    WIDTH,
)
from fvs_engine.splat.triton_kernels import binning
from fvs_engine.splat.triton_kernels import guard as guard_module
from fvs_engine.splat.triton_kernels.binning import BLOCK, bin_hits
from fvs_engine.splat.triton_kernels.guard import (
    HALTED_NOT_FINITE,
    HALTED_OVERFLOW,
    HITS_NEEDED,
    REASON,
    StepGuard,
    new_guard,
)
from fvs_engine.splat.triton_kernels.tiles import TILE_HEIGHT, TILE_WIDTH, tile_counts

SIZE = (SMALL_CAMERA.width, SMALL_CAMERA.height)


def lists(hits):
    starts = hits.tile_starts.tolist()
    return [hits.listed[a:b].tolist() for a, b in pairwise(starts)]


def least_exponents(record, columns, rows):
    """The least exponent of a splat on a fine grid over every tile, its borders included: [rows, columns]."""
    x = torch.linspace(0, TILE_WIDTH, 129, dtype=torch.float64)
    y = torch.linspace(0, TILE_HEIGHT, 65, dtype=torch.float64)
    dx = (torch.arange(columns)[:, None] * TILE_WIDTH + x)[None, None] - record[CENTER_X].double()
    dy = (torch.arange(rows)[:, None] * TILE_HEIGHT + y)[:, :, None, None] - record[CENTER_Y].double()
    a, k, b = record[[FACTOR_A, FACTOR_K, FACTOR_B]].double()
    return ((a * (dx - k * dy)) ** 2 + (b * dy) ** 2).amin((1, 3))


@pytest.mark.parametrize("name", FOR_THE_INTERPRETER)
def test_tiles_list_front_to_back_what_touches_them(name):
    few = project_scenes(build_few(name))
    records, radii = few.records.cpu(), few.radii.cpu()
    cameras, count = radii.shape
    columns, rows = tile_counts(SIZE)
    hits = bin_hits(few, SIZE)
    found = lists(hits)
    assert len(found) == cameras * columns * rows
    for camera in range(cameras):
        order = sorted(range(count), key=lambda n: (float(records[camera, n, DEPTH]), n))
        visible = [n for n in order if radii[camera, n] > 0]
        assert hits.order[camera, : len(visible)].tolist() == visible
        reached = {n: least_exponents(records[camera, n], columns, rows) for n in visible}
        for tile in range(columns * rows):
            listed = [splat - camera * count for splat in found[camera * columns * rows + tile]]
            assert listed == [n for n in visible if n in listed], "front to back, each once"
            for n in visible:
                cut = math.log(float(records[camera, n, OPACITY]) / ALPHA_MIN)
                least = float(reached[n].flatten()[tile])
                if n in listed:  # 0.02 px of slack, and the grid is not infinitely fine
                    assert math.sqrt(least) < math.sqrt(cut) + 0.1
                else:
                    assert least >= cut


@pytest.mark.parametrize("name", ["random", "needles"])
def test_hits_of_a_splat_are_neighbours(name):
    few = project_scenes(build_few(name))
    count = few.radii.shape[1]
    hits = bin_hits(few, SIZE)
    assert hits.capacity == int(hits.starts[-1])
    assert sorted(hits.numbers.tolist()) == list(range(hits.capacity))
    for number, splat in zip(hits.numbers.tolist(), hits.listed.tolist(), strict=False):
        place = int(torch.searchsorted(hits.starts, number, right=True)) - 1
        camera = place // count
        assert splat == camera * count + int(hits.order[camera, place - camera * count])


def round_splat(x, y, extent, depth=1.0):
    """The record of a splat whose ellipse is a circle."""
    record = torch.zeros(RECORD_SIZE)
    record[[CENTER_X, CENTER_Y]] = torch.tensor([x, y])
    record[[EXTENT_X, EXTENT_Y, WIDTH, HEIGHT]] = extent
    record[[SLOPE_X, SLOPE_Y]] = 0.0
    record[DEPTH] = depth
    return record


@pytest.mark.parametrize(
    ("x", "y", "tiles"),
    [
        (16.0, 8.0, {0, 1, 2, 3}),
        (16.0, 4.0, {0, 1}),
        (8.0, 8.0, {0, 2}),
        (15.0, 3.0, {0, 1}),  # its extent ends on the border: 0.02 px are kept for rounding
        (14.9, 3.0, {0}),
        (15.2, 7.2, {0, 1, 2}),  # the corner of the fourth tile is in the box, not in the circle
        (0.0, 0.0, {0}),
        (32.0, 16.0, {3}),
        (-0.6, 16.6, {2}),
    ],
)
def test_a_splat_on_borders_of_tiles(x, y, tiles):
    record = round_splat(x, y, 1.0)
    found = lists(bin_hits(projected(record[None, None], torch.ones(1, 1)), (32, 16)))
    assert {tile for tile, listed in enumerate(found) if listed} == tiles


@pytest.mark.parametrize("size", [(1, 1), (3840, 2160), (8000, 7999)])
def test_sizes_of_images(size):
    """One that covers all, one in the last pixel; half a million tiles have numbers beyond 16 bits."""
    width, height = size
    corner = round_splat(width - 0.5, height - 0.5, 0.4, depth=1.0)
    everywhere = round_splat(10.0, 10.0, 1e6, depth=2.0)
    if width > 1:
        everywhere[EXTENT_Y] = everywhere[HEIGHT] = 5.0  # a strip of two rows of tiles
    hits = bin_hits(projected(torch.stack([everywhere, corner])[None], torch.ones(1, 2)), size)
    columns, rows = tile_counts(size)
    assert len(hits.tile_starts) == columns * rows + 1
    assert int(hits.tile_starts[-1]) == (2 if width == 1 else 2 * columns + 1)
    last = slice(int(hits.tile_starts[-2]), int(hits.tile_starts[-1]))
    assert hits.listed[last].tolist() == ([1, 0] if width == 1 else [1])


@pytest.mark.parametrize("missing", [1, BLOCK, 300])
def test_overflow_sets_the_guard_and_keeps_what_there_is_room_for(missing, monkeypatch):
    records = torch.stack([round_splat(50.0, 40.0, 1e4, depth=i) for i in range(1, 13)])
    splats = projected(records[None], torch.ones(1, len(records)))
    size = (100, 80)  # 70 tiles
    needed = len(records) * 70
    guard = new_guard(DEVICE)
    beyond = []

    def with_canaries(*shape, dtype, device):
        if dtype not in (torch.int16, torch.int32) or not isinstance(shape[0], int):
            return torch.full(shape, -7, dtype=dtype, device=device)
        room = torch.full((shape[0] + 2 * BLOCK,), -7, dtype=dtype, device=device)
        beyond.append(room[shape[0] :])
        return room[: shape[0]]

    monkeypatch.setattr(binning.torch, "empty", with_canaries)
    hits = bin_hits(splats, size, needed - missing, guard)
    assert guard.tolist() == [HALTED_OVERFLOW, needed]
    assert len(beyond) == 5
    assert all((room == -7).all() for room in beyond)
    assert int(hits.tile_starts[-1]) == needed - missing
    assert hits.listed.min() >= 0
    assert hits.listed.max() < len(records)


def test_room_that_is_not_needed_stays_empty():
    few = project_scenes(build_few("random"))
    guard = new_guard(DEVICE)
    exact = bin_hits(few, SIZE)
    roomy = bin_hits(few, SIZE, exact.capacity + 2 * BLOCK + 3, guard)
    assert guard.tolist() == [0, 0]
    assert lists(roomy) == lists(exact)
    assert torch.equal(roomy.tile_starts, exact.tile_starts)
    assert torch.equal(roomy.numbers[: exact.capacity], exact.numbers)
    assert roomy.listed.min() >= 0  # blending reads ahead of the last slot
    assert roomy.listed.max() < few.radii.numel()


def test_a_guard_that_is_set_keeps_its_reason_and_the_largest_need():
    splats = projected(round_splat(8.0, 4.0, 3.0)[None, None], torch.ones(1, 1))
    guard = new_guard(DEVICE)
    guard[REASON], guard[HITS_NEEDED] = HALTED_NOT_FINITE, 5
    bin_hits(splats, (100, 80), 0, guard)
    assert guard.tolist() == [HALTED_NOT_FINITE, 5]


def test_a_splat_that_another_rounding_moves_behind_the_image_has_no_hits():
    far = round_splat(2e9, 40.0, 1e3)
    far[EXTENT_X] = 1.9999e9  # it begins 100,000 px behind the image
    splats = projected(torch.stack([far, round_splat(50.0, 40.0, 1e4)])[None], torch.ones(1, 2))
    hits = bin_hits(splats, (100, 80))
    assert hits.starts.tolist() == [0, 0, 70]


def test_more_hits_than_kernels_count(monkeypatch):
    splats = projected(round_splat(50.0, 40.0, 1e4)[None, None], torch.ones(1, 1))
    monkeypatch.setattr(guard_module, "MOST_HITS", 69)
    with pytest.raises(DeviceMemoryError, match="70 hits"):
        bin_hits(splats, (100, 80))
    guard = StepGuard(DEVICE)
    guard.make_room(60)
    assert guard.capacity == 69
    with pytest.raises(DeviceMemoryError, match="70 hits"):
        guard.make_room(70)
