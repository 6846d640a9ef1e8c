"""A reconstruction of real photographs, small enough to run every time; its tests share it."""

import os
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from quick_reconstruction import OPTIONS

Fvs = Callable[..., Any]


@pytest.fixture(scope="session")
def photographs(kermit_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Kermit at half its size, as a careless user hands it over: files of every kind, some of them bad."""
    folder, halved = tmp_path_factory.mktemp("photographs"), tmp_path_factory.mktemp("halved")
    for path in kermit_dir.iterdir():
        with Image.open(path) as image:
            image.resize((320, 240)).save(halved / path.name, quality=95, exif=image.getexif())
    good = sorted(halved.iterdir())
    for path in good[:6]:
        shutil.copyfile(path, folder / path.name)
    (folder / "masks").mkdir()
    mask = np.full((240, 320), 255, dtype=np.uint8)
    mask[:60, :80] = 0
    Image.fromarray(mask).save(folder / "masks" / f"{good[2].stem}.png")
    (folder / "more of them").mkdir()
    with Image.open(good[6]) as image:
        exif = Image.Exif()
        exif[0x0112] = 6
        image.transpose(Image.Transpose.ROTATE_90).save(
            folder / "more of them" / "held upright.jpg", quality=95, exif=exif
        )
    with Image.open(good[7]) as image:
        image.convert("CMYK").save(
            folder / "more of them" / os.fsdecode("für den Druck.jpg".encode("latin-1")), quality=95
        )
    with Image.open(good[8]) as image:
        opaque = image.convert("RGBA")
        opaque.save(folder / "alpha.png")
    with Image.open(good[9]) as image:
        grey = np.asarray(image.convert("L"), dtype=np.uint16) * 257
        Image.fromarray(grey).save(folder / "sixteen bits.tif")
    with Image.open(good[10]) as image:
        image.resize((240, 180), Image.Resampling.LANCZOS).save(folder / "smaller.jpg", quality=95)
    shutil.copyfile(good[0], folder / os.fsdecode(b"the first again \xe9.jpg"))
    (folder / os.fsdecode(b"cut off \xe9.jpg")).write_bytes(good[1].read_bytes()[:10_000])
    (folder / "letter.jpg").write_text("Dear reader")
    (folder / "notes.txt").write_text("not a photograph, and not called one")
    return folder


@pytest.fixture(scope="session")
def first_run(
    fvs: Fvs,
    photographs: Path,
    tmp_path_factory: pytest.TempPathFactory,
    without_children: Callable[[], AbstractContextManager[None]],
) -> tuple[Path, Any]:
    """The output folder of one reconstruction, and how its run ended. Tests must not change it."""
    out = tmp_path_factory.mktemp("results") / "out"
    with without_children():
        return out, fvs("reconstruct", photographs, "--out", out, "--json", *OPTIONS)


@pytest.fixture
def out(first_run: tuple[Path, Any], tmp_path: Path) -> Path:
    """A copy of the result that the test may change."""
    shutil.copytree(first_run[0], tmp_path / "out")
    return tmp_path / "out"
