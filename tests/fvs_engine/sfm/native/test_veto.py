import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from fvs_engine.sfm.batch.mapping import leave_out
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_ids, read_verified_pairs
from fvs_engine.sfm.colmap.model import open_colmap
from fvs_engine.sfm.jobs import VetoPairs
from fvs_engine.sfm.native import veto as veto_module
from fvs_engine.sfm.native.veto import veto
from fvs_engine.sfm.pose_priors import PosePriors


@pytest.mark.parametrize("cut", ["model", "one image"])
def test_images_that_match_each_other_alone_are_named(
    cut: str, kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """All of them photographed after a receiver jumped: their positions fit each other."""
    database = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", database)
    new = kermit_names[-3:]
    model = open_colmap(kermit_sfm.model_dir)
    leave_out(model, new)
    (tmp_path / "model").mkdir()
    model.write_binary(tmp_path / "model")
    ids = image_ids(database)
    numbers = {ids[name] for name in (new if cut == "model" else new[:1])}
    every = read_verified_pairs(database, 15)
    vetoed = {(pair.first, pair.second) for pair in every if len(numbers & {pair.first, pair.second}) == 1}
    assert any(numbers >= {pair.first, pair.second} for pair in every) == (cut == "model")
    monkeypatch.setattr(veto_module, "believed_frame", lambda *_: SimpleNamespace())
    monkeypatch.setattr(veto_module, "orientations_contradict", lambda *_: False)
    monkeypatch.setattr(
        veto_module,
        "contradicted_pairs",
        lambda pairs, *_: [pair for pair in pairs if (pair.first, pair.second) in vetoed],
    )
    answer = veto(
        VetoPairs(database=database, model_dir=tmp_path / "model", names=tuple(new), priors=PosePriors()),
        lambda _: None,
    )
    assert answer.without == tuple(new if cut == "model" else new[:1])
