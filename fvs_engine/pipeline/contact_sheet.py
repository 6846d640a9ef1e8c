"""The contact sheet: renders of ranked candidates beside their spectra, best first, in one PNG.

It serves to judge a ranking by eye: a view that ranks first should look blurred, and its spectrum should be
dark away from the middle. All spectra share one colour scale, so that they can be compared.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from fvs_engine.candidates import RankedCandidate
from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import write_bytes_atomically
from fvs_engine.splat.render import log_magnitude
from fvs_schema.candidates import CandidateStatus

_TILE_AREA_PX = 320 * 214
_SHEET_WIDTH_PX = 1800
_MARGIN, _GAP, _HEADER, _CAPTION = 36, 22, 96, 58
_BACKGROUND, _CARD = (18, 19, 23), (31, 33, 39)
_TEXT, _MUTED, _ACCENT, _WARNING = (236, 238, 242), (150, 155, 166), (255, 190, 92), (240, 128, 112)
_COLOR_MAP = "inferno"


@dataclass(frozen=True, eq=False)
class SheetEntry:
    """One candidate on the sheet; ``image`` is its render, float [H, W, 3] (clamped to [0, 1])."""

    candidate: RankedCandidate
    image: NDArray[np.floating]


@dataclass(frozen=True)
class _Layout:
    """Sizes in px. A cell holds render and spectrum, above each other or (``upright``) side by side."""

    columns: int
    tile_width: int
    tile_height: int
    upright: bool

    @property
    def cell_width(self) -> int:
        return self.tile_width * 2 if self.upright else self.tile_width

    @property
    def cell_height(self) -> int:
        return self.tile_height * (1 if self.upright else 2) + _CAPTION


def contact_sheet(path: Path, entries: Sequence[SheetEntry], *, title: str = "Next views") -> None:
    """Write the sheet of ``entries``, in their order, as a PNG.

    Raises ``InvalidInputError`` for no entries or images of different shapes, ``StorageError`` when the file
    cannot be written.
    """
    shapes = {entry.image.shape for entry in entries}
    if len(shapes) != 1:
        raise InvalidInputError("A contact sheet needs candidates whose renders have one size.")
    height, width, _ = shapes.pop()
    layout = _layout(len(entries), width, height)
    rows = math.ceil(len(entries) / layout.columns)
    sheet = Image.new(
        "RGB",
        (
            2 * _MARGIN + layout.columns * (layout.cell_width + _GAP) - _GAP,
            _HEADER + rows * (layout.cell_height + _GAP) - _GAP + _MARGIN,
        ),
        _BACKGROUND,
    )
    spectra = [log_magnitude(entry.image) for entry in entries]
    low, high = _shared_range(spectra)
    _draw_header(ImageDraw.Draw(sheet), sheet.width, title, low, high)
    for index, (entry, spectrum) in enumerate(zip(entries, spectra, strict=True)):
        row, column = divmod(index, layout.columns)
        corner = (_MARGIN + column * (layout.cell_width + _GAP), _HEADER + row * (layout.cell_height + _GAP))
        _draw_cell(sheet, corner, layout, entry, _colored(spectrum, low, high))
    buffer = io.BytesIO()
    sheet.save(buffer, format="PNG")
    write_bytes_atomically(path, buffer.getvalue())


def _layout(count: int, width: int, height: int) -> _Layout:
    tile_width = round(math.sqrt(_TILE_AREA_PX * width / height))
    tile_height = round(_TILE_AREA_PX / tile_width)
    upright = height > width
    fitting = (_SHEET_WIDTH_PX - 2 * _MARGIN + _GAP) // (tile_width * (2 if upright else 1) + _GAP)
    # As few rows as fit, then as few columns as these rows need, so that the last row is full.
    rows = math.ceil(count / max(1, fitting))
    return _Layout(max(math.ceil(count / rows), min(count, 2)), tile_width, tile_height, upright)


def _shared_range(spectra: Sequence[NDArray[np.float32]]) -> tuple[float, float]:
    """The values of the darkest and the brightest colour: all but the extremes of all spectra."""
    finite = np.concatenate([spectrum[np.isfinite(spectrum)] for spectrum in spectra])
    if finite.size == 0:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(finite, [1.0, 99.8]))
    return low, max(high, low + 1e-3)


def _colored(spectrum: NDArray[np.float32], low: float, high: float) -> Image.Image:
    shares = np.clip((np.nan_to_num(spectrum, neginf=low) - low) / (high - low), 0.0, 1.0)
    colors = matplotlib.colormaps[_COLOR_MAP](shares, bytes=True)
    return Image.fromarray(np.ascontiguousarray(colors[..., :3]))


def _draw_header(draw: ImageDraw.ImageDraw, width: int, title: str, low: float, high: float) -> None:
    """Title, how to read the sheet, and the colour scale; a narrow sheet has room for less."""
    draw.text((_MARGIN, 24), title, _TEXT, _font(26, bold=True))
    left, right, bar_width = _MARGIN, width - _MARGIN, 160
    how = ["lowest score first", "render and spectrum ln |F|", "0 cycles/px in the middle, ½ at the edges"]
    while len(how) > 1 and draw.textlength("  ·  ".join(how), _font(15)) > right - left - bar_width - 60:
        how.pop()
    draw.text((left, 60), "  ·  ".join(how), _MUTED, _font(15))
    if len(how) == 1:
        return
    scale = matplotlib.colormaps[_COLOR_MAP](np.linspace(0, 1, bar_width), bytes=True)
    for i, (red, green, blue, _) in enumerate(scale.tolist()):
        draw.line([(right - bar_width + i, 40), (right - bar_width + i, 52)], (red, green, blue))
    draw.text((right - bar_width, 60), _number(low, 1), _MUTED, _font(14))
    draw.text((right, 60), _number(high, 1), _MUTED, _font(14), anchor="ra")


def _draw_cell(
    sheet: Image.Image, corner: tuple[int, int], layout: _Layout, entry: SheetEntry, spectrum: Image.Image
) -> None:
    left, top = corner
    draw = ImageDraw.Draw(sheet)
    bottom_right = (left + layout.cell_width - 1, top + layout.cell_height - 1)
    draw.rounded_rectangle([corner, bottom_right], radius=8, fill=_CARD)
    tile = (layout.tile_width, layout.tile_height)
    colors = (255.0 * np.clip(np.nan_to_num(entry.image), 0.0, 1.0) + 0.5).astype(np.uint8)
    render_corner = (left, top + _CAPTION)
    beside = (layout.tile_width, 0) if layout.upright else (0, layout.tile_height)
    spectrum_corner = (render_corner[0] + beside[0], render_corner[1] + beside[1])
    sheet.paste(Image.fromarray(colors).resize(tile, Image.Resampling.LANCZOS), render_corner)
    sheet.paste(spectrum.resize(tile, Image.Resampling.BOX), spectrum_corner)
    _draw_caption(draw, (left + 14, top), layout.cell_width - 28, entry.candidate)


def _draw_caption(
    draw: ImageDraw.ImageDraw, corner: tuple[int, int], width: int, candidate: RankedCandidate
) -> None:
    """Rank at the left, score at the right, id and coverage between them."""
    left, top = corner
    middle = top + _CAPTION // 2
    rank = "–" if candidate.rank is None else str(candidate.rank)
    rank_color = _ACCENT if candidate.rank is not None else _MUTED
    draw.text((left, middle), rank, rank_color, _font(28, bold=True), anchor="lm")
    score = "no score" if candidate.score is None else _number(candidate.score, 3)
    score_color = _TEXT if candidate.score is not None else _MUTED
    draw.text((left + width, middle), score, score_color, _font(19, bold=True), anchor="rm")

    start = left + draw.textlength(rank, _font(28, bold=True)) + 14
    room = left + width - draw.textlength(score, _font(19, bold=True)) - 14 - start
    name = _shortened(draw, candidate.name, room, _font(15))
    draw.text((start, middle - 10), name, _TEXT, _font(15), anchor="lm")
    ranked = candidate.status is CandidateStatus.RANKED
    share = "" if candidate.coverage is None else f"{candidate.coverage:.0%} "
    note = share + ("covered" if ranked else f"· {candidate.status.value}")
    color = _MUTED if ranked else _WARNING
    draw.text((start, middle + 11), _shortened(draw, note, room, _font(13)), color, _font(13), anchor="lm")


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", "−")


def _shortened(draw: ImageDraw.ImageDraw, text: str, room_px: float, font: ImageFont.FreeTypeFont) -> str:
    """``text`` without its middle until it fits: file names differ at both ends."""
    kept = len(text)
    shown = text
    while kept > 2 and draw.textlength(shown, font) > room_px:
        kept -= 1
        shown = f"{text[: (kept + 1) // 2]}…{text[len(text) - kept // 2 :]}"
    return shown


def _font(size_px: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, as shipped with matplotlib."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size_px)
