import numpy as np
import pytest
from numpy.typing import NDArray
from tiff_files import DEFLATE, LERC, MIN_IS_BLACK, MIN_IS_WHITE, RAW, RGB, tiff_file

from fvs_engine.images.limits import UnusableImageError
from fvs_engine.images.pixels import decode

GREY = np.linspace(0, 65_535, 40 * 48).astype(np.uint16).reshape(40, 48, 1)
COLOR = np.concatenate([GREY, GREY[::-1], GREY[:, ::-1]], axis=2)

every_order = pytest.mark.parametrize("order", ["<", ">"])
every_compression = pytest.mark.parametrize("compression", [RAW, DEFLATE])


def decoded(content: bytes) -> NDArray[np.int64]:
    return np.asarray(decode(content).rgb).astype(np.int64)


def grey_of(content: bytes) -> NDArray[np.int64]:
    rgb = decoded(content)
    assert (rgb == rgb[:, :, :1]).all()
    return rgb[:, :, 0]


@every_order
@every_compression
@pytest.mark.parametrize("planar", [False, True])
def test_colours_of_16_bits_are_read_however_they_are_stored(
    order: str, compression: int, planar: bool
) -> None:
    content = tiff_file(COLOR, RGB, order, planar=planar, compression=compression)
    assert abs(decoded(content) - COLOR / 257).max() < 1.0


@every_order
@every_compression
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_whose_least_value_is_white_is_inverted(
    order: str, compression: int, dtype: type[np.unsignedinteger]
) -> None:
    values = (GREY >> 8 if dtype == np.uint8 else GREY).astype(dtype)
    content = tiff_file(values, MIN_IS_WHITE, order, compression=compression)
    assert abs(grey_of(content) - (255 - GREY[:, :, 0] / 257)).max() <= 1.0


@every_order
def test_grey_of_12_bits_in_16_has_its_full_range(order: str) -> None:
    expected = GREY[:, :, 0] / 257
    assert abs(grey_of(tiff_file(GREY >> 4, MIN_IS_BLACK, order)) - expected).max() <= 1.0
    assert abs(grey_of(tiff_file(GREY >> 4, MIN_IS_WHITE, order)) - (255 - expected)).max() <= 1.0


def test_colours_of_12_bits_in_16_are_refused() -> None:
    with pytest.raises(UnusableImageError, match="12 bits") as caught:
        decode(tiff_file(COLOR >> 4, RGB))
    assert "65535" in (caught.value.hint or "")


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (tiff_file(np.concatenate([COLOR, GREY, GREY], axis=2), RGB), "5 channels of 16-bit integers"),
        (tiff_file(COLOR.astype(np.float32), RGB), "3 channels of 32-bit floating-point numbers"),
        (tiff_file(GREY.astype(np.float32), MIN_IS_BLACK), "1 channel of 32-bit floating-point numbers"),
        (tiff_file(GREY.astype(np.float64), MIN_IS_BLACK, ">"), "1 channel of 64-bit floating-point numbers"),
        (tiff_file(GREY.astype(np.int16), MIN_IS_BLACK), "1 channel of 16-bit signed integers"),
        (tiff_file(GREY.astype(np.uint32), MIN_IS_BLACK, ">"), "1 channel of 32-bit integers"),
        (tiff_file(COLOR, RGB, compression=LERC), "compression 34887"),
    ],
)
def test_another_kind_is_refused_by_name(content: bytes, kind: str) -> None:
    with pytest.raises(UnusableImageError, match=f"TIFF (of|with) {kind}, which is not read here") as caught:
        decode(content)
    assert "8 or 16 bits" in (caught.value.hint or "")
