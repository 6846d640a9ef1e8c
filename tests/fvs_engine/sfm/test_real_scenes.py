"""The numbers that issue 2 asks for, on whole scenes with ground truth."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fvs_engine.errors import ReconstructionError
from fvs_engine.geometry.alignment import umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.evidence import centre_spread
from fvs_engine.sfm.reconstruct import reconstruct
from fvs_engine.sfm.reconstruction import read_colmap
from fvs_engine.sfm.settings import SfmSettings

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

Centres = dict[str, NDArray[np.float64]]


def strecha_centres(folder: Path) -> Centres:
    """Camera centres in m: the eighth row of each survey file."""
    centres = {}
    for file in (folder / "gt_dense_cameras").glob("*.camera"):
        rows = [line.split() for line in file.read_text().splitlines() if line.strip()]
        centres[file.name.removesuffix(".camera")] = np.array(rows[7], dtype=np.float64)
    return centres


def fox_centres(folder: Path) -> Centres:
    frames = json.loads((folder / "transforms.json").read_text())["frames"]
    return {Path(f["file_path"]).name: np.array(f["transform_matrix"])[:3, 3] for f in frames}


def errors(found: Centres, truth: Centres) -> tuple[NDArray[np.float64], float]:
    """Distances after Umeyama, and the spread of the true centres."""
    source, target = np.stack(list(found.values())), np.stack([truth[name] for name in found])
    return np.linalg.norm(umeyama(source, target).apply(source) - target, axis=1), centre_spread(target)


def image_names(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder / "images").iterdir())


def test_fox_is_right_and_no_wrong_model_passes(data_dir: Path, tmp_path: Path):
    folder = data_dir / "fox"
    truth = fox_centres(folder)
    result = reconstruct(folder / "images", image_names(folder), tmp_path, SfmSettings(), Monitor())
    assert result.report.registered == 50
    found, spread = errors(result.reconstruction.centres(), truth)
    assert np.median(found) <= 0.01 * spread
    verdicts = {candidate.mapper: candidate.verdict for candidate in result.report.candidates}
    wrong = [
        mapper
        for mapper in verdicts
        if np.median(errors(read_colmap(tmp_path / "mapping" / mapper / "0").centres(), truth)[0])
        > 0.05 * spread
    ]
    # The repeating wallpaper leads global mapping astray on these photographs, all 50 "registered".
    assert wrong == ["global"]
    assert verdicts["global"] == "refused"


def test_fountain_without_intrinsics_is_right_to_ten_millimetres(data_dir: Path, tmp_path: Path):
    folder = data_dir / "fountain-P11"
    result = reconstruct(folder / "images", image_names(folder), tmp_path, SfmSettings(), Monitor())
    found, _ = errors(result.reconstruction.centres(), strecha_centres(folder))
    assert len(found) == 11
    assert np.median(found) <= 0.010


def test_castle_without_intrinsics_is_right_or_refused(data_dir: Path, tmp_path: Path):
    folder = data_dir / "castle-P19"
    result = reconstruct(folder / "images", image_names(folder), tmp_path, SfmSettings(), Monitor())
    found, _ = errors(result.reconstruction.centres(), strecha_centres(folder))
    assert len(found) == 19
    assert np.median(found) <= 0.500


def test_banana_fails_clearly_or_passes_the_gate(data_dir: Path, tmp_path: Path):
    folder = data_dir / "banana" / "images"
    names = sorted(path.name for path in folder.iterdir())
    hint = ""
    try:
        result = reconstruct(folder, names, tmp_path, SfmSettings(), Monitor())
    except ReconstructionError as error:
        hint = error.hint
    else:
        assert result.report.verdict in ("accepted", "doubtful")
        return
    assert hint
