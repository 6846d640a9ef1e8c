import os
from collections.abc import Callable
from pathlib import Path

import pytest
from fvs_service.images.inspector import Inspector

from fvs_engine.images.limits import ImageLimits
from fvs_schema.images import Verdict


@pytest.mark.system
@pytest.mark.process
def test_a_decoder_that_hangs_is_killed_and_the_next_image_is_inspected(
    photograph: Callable[..., bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A FIFO that nothing writes to blocks its reader without using processor time."""
    (tmp_path / "good.jpg").write_bytes(photograph())
    os.mkfifo(tmp_path / "hangs.jpg")
    monkeypatch.setattr("fvs_service.images.inspector._CPU_S", 0.3)
    inspector = Inspector(ImageLimits(max_pixels=1_000_000, min_side_px=32), children=1)
    try:
        assert inspector.inspect(tmp_path / "good.jpg").verdict is Verdict.ACCEPTED
        assert inspector.inspect(tmp_path / "hangs.jpg").verdict is Verdict.UNREADABLE
        assert inspector.inspect(tmp_path / "good.jpg").verdict is Verdict.ACCEPTED
    finally:
        inspector.close()
