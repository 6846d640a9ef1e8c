import numpy as np
import pytest
from PIL import Image

from fvs_engine.candidates import RankedCandidate
from fvs_engine.errors import InvalidInputError, StorageError
from fvs_engine.pipeline.contact_sheet import SheetEntry, contact_sheet, log_magnitude
from fvs_schema.candidates import CandidateStatus


def entry(number: int, image: np.ndarray, name: str | None = None) -> SheetEntry:
    return SheetEntry(
        RankedCandidate(
            rank=number,
            name=name or f"view {number}",
            score=-1.5,
            status=CandidateStatus.RANKED,
            coverage=0.8,
        ),
        image,
    )


def blank(shape=(60, 90, 3)) -> SheetEntry:
    status = CandidateStatus.OUT_OF_MODEL
    return SheetEntry(
        RankedCandidate(rank=None, name="void", score=None, status=status, coverage=0.0), np.zeros(shape)
    )


def flat(color, shape=(60, 90)) -> np.ndarray:
    return np.broadcast_to(np.array(color, dtype=np.float32), (*shape, 3)).copy()


def contains(sheet: Image.Image, color) -> np.ndarray:
    """Positions (row, column) of the pixels with this colour."""
    return np.argwhere((np.asarray(sheet) == np.array(color)).all(axis=-1))


def test_renders_stand_in_the_order_of_the_ranking(tmp_path):
    colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
    path = tmp_path / "sheet.png"
    contact_sheet(path, [entry(i + 1, flat(color)) for i, color in enumerate(colors)])
    with Image.open(path) as sheet:
        assert sheet.format == "PNG"
        places = [contains(sheet, 255 * np.array(color)) for color in colors]
    assert min(len(place) for place in places) > 10_000
    assert places[0][:, 1].max() < places[1][:, 1].min()
    assert places[1][:, 1].max() < places[2][:, 1].min()


@pytest.mark.parametrize("shape", [(60, 90), (90, 60), (50, 50), (20, 200)])
@pytest.mark.parametrize("count", [1, 2, 7])
def test_every_render_keeps_its_proportions(tmp_path, shape, count):
    path = tmp_path / "sheet.png"
    contact_sheet(path, [entry(i + 1, flat((0, 1, 0), shape)) for i in range(count)])
    with Image.open(path) as sheet:
        place = contains(sheet, (0, 255, 0))
        assert sheet.width <= 1800 or count == 1
    first = place[(place[:, 0] <= place[0, 0] + 400)]
    rows = np.unique(first[first[:, 1] == place[0, 1]][:, 0])
    columns = np.sort(place[place[:, 0] == place[0, 0]][:, 1])
    tile_width = 1 + int(np.argmax(np.append(np.diff(columns), 2) > 1))
    tile_height = 1 + int(np.argmax(np.append(np.diff(rows), 2) > 1))
    assert tile_width / tile_height == pytest.approx(shape[1] / shape[0], rel=0.03)


def test_blurred_views_have_darker_spectra_on_the_shared_scale(tmp_path):
    noise = np.random.default_rng(0).uniform(size=(60, 90, 3))
    smooth = noise.copy()
    for axis in (0, 1):
        smooth = (smooth + np.roll(smooth, 1, axis) + np.roll(smooth, 2, axis)) / 3
    path = tmp_path / "sheet.png"
    contact_sheet(path, [entry(1, smooth), entry(2, noise)])
    with Image.open(path) as sheet:
        pixels = np.asarray(sheet.convert("L"), dtype=float)
    spectra = pixels[-150:-60]
    middle = pixels.shape[1] // 2
    assert spectra[:, :middle].mean() < 0.8 * spectra[:, middle:].mean()


def test_what_has_no_score_or_is_not_finite_is_still_shown(tmp_path):
    broken = flat((0.5, 0.5, 0.5))
    broken[3, 4] = np.nan
    contact_sheet(tmp_path / "a.png", [entry(1, broken), blank()])
    contact_sheet(tmp_path / "b.png", [blank()])
    with Image.open(tmp_path / "a.png") as both, Image.open(tmp_path / "b.png") as alone:
        grey = contains(both, (128, 128, 128))
        black = contains(both, (0, 0, 0))
        assert len(grey) > 10_000
        assert len(black[black[:, 1] > grey[:, 1].max()]) > 10_000
        assert len(contains(alone, (0, 0, 0))) > 10_000


def test_long_names_stay_in_their_cell(tmp_path):
    contact_sheet(tmp_path / "long.png", [entry(1, flat((0, 1, 0)), "ä" * 500), entry(2, flat((0, 0, 1)))])
    contact_sheet(tmp_path / "short.png", [entry(1, flat((0, 1, 0)), "a"), entry(2, flat((0, 0, 1)))])
    with Image.open(tmp_path / "long.png") as long, Image.open(tmp_path / "short.png") as short:
        assert long.size == short.size
        second = slice(long.width // 2, None)
        np.testing.assert_array_equal(np.asarray(long)[:, second], np.asarray(short)[:, second])


def test_the_spectrum_has_its_constant_in_the_middle():
    spectrum = log_magnitude(flat((0.5, 0.5, 0.5), (6, 8)))
    assert spectrum.shape == (6, 8)
    assert spectrum[3, 4] == pytest.approx(np.log(0.5 * 48), abs=1e-5)
    assert np.isneginf(np.delete(spectrum.ravel(), 3 * 8 + 4)).all()


def test_sheets_that_make_no_sense_are_refused(tmp_path):
    with pytest.raises(InvalidInputError):
        contact_sheet(tmp_path / "sheet.png", [])
    with pytest.raises(InvalidInputError):
        contact_sheet(tmp_path / "sheet.png", [entry(1, flat((1, 0, 0))), entry(2, flat((1, 0, 0), (9, 9)))])


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StorageError, match="file"):
        contact_sheet(tmp_path / "file" / "sheet.png", [entry(1, flat((1, 0, 0)))])
