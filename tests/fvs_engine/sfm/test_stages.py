"""Tests of the runs of native jobs over images."""

from pathlib import Path

import pytest

from fvs_engine.errors import DamagedOutputError, NativeJobError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.jobs import CopyFeatures
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages


@pytest.mark.parametrize("damaged", [False, True])
def test_an_image_is_not_blamed_for_a_damaged_database(
    damaged: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stages = Stages(SfmFolder(tmp_path), tmp_path, SfmSettings(), Monitor())
    if damaged:
        stages.folder.database.write_bytes(b"no database" * 1000)

    def native(request: CopyFeatures, **_: object) -> None:
        if damaged or "b" in request.names:
            raise NativeJobError("match", "no reason")

    monkeypatch.setattr(stages, "native", native)
    with pytest.raises(DamagedOutputError if damaged else CulpritError):
        stages.native_over(
            ["a", "b"], lambda some: CopyFeatures(source=tmp_path, target=tmp_path, names=tuple(some))
        )
