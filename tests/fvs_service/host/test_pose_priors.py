from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fvs_service.host.protocol.messages import RunJob
from fvs_service.host.runner import scene_jobs
from fvs_service.host.runner.image_files import PreparedImages
from fvs_service.host.runner.pose_priors import pose_priors
from fvs_service.settings import WorkerSettings
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import FocalPrior
from fvs_schema.images import Image, Prior, PriorSource, Registration, Verdict
from fvs_schema.jobs import JobKind, JobRequest
from fvs_schema.scenes import AltitudeDatum, CameraPrior, Origin

_ORIGIN = Origin(latitude_deg=48.0, longitude_deg=7.0, altitude_m=400.0)


def _image(number: int, prior: Prior | None) -> Image:
    return Image(
        digest=f"sha256:{number:064x}",
        scene_id="scn",
        number=number,
        name=f"{number}.jpg",
        verdict=Verdict.ACCEPTED,
        reason="",
        hint="",
        warnings=(),
        duplicate_of=None,
        registration=Registration.PENDING,
        size_bytes=1,
        format="JPEG",
        width_px=64,
        height_px=48,
        focal_length_px=None,
        sharpness=1.0,
        prior=prior,
        captured_at=None,
        received_at=now(),
    )


def _local(number: int) -> Image:
    return _image(number, Prior(source=PriorSource.REQUEST, x_m=number, y_m=2.0, z_m=3.0))


def _geodetic(number: int, source: PriorSource) -> Image:
    place = {"latitude_deg": 48.0, "longitude_deg": 7.0, "altitude_m": 400.0 + number}
    return _image(number, Prior(source=source, altitude_datum=AltitudeDatum.SEA_LEVEL, **place))


def _named(*images: Image) -> Mapping[str, Image]:
    return {f"{image.number:06d}.jpg": image for image in images}


def test_priors_are_in_the_world_frame() -> None:
    found = pose_priors(_named(_local(1), _image(2, None)), None)
    assert found is not None
    assert found == PosePriors(by_name={"000001.jpg": PosePrior(position=(1.0, 2.0, 3.0))})
    mixed = _named(_geodetic(1, PriorSource.METADATA), _geodetic(2, PriorSource.REQUEST))
    by_gps = pose_priors(mixed, _ORIGIN)
    assert by_gps is not None
    assert (by_gps.position_sigmas(list(mixed)) > 0).all()
    np.testing.assert_allclose(by_gps.positions(["000002.jpg"])[0], [0.0, 0.0, 2.0], atol=1e-6)
    assert len(by_gps.by_name) == 2


def test_priors_have_the_standard_deviations_of_the_sender() -> None:
    """Also those of a position in the file, which structure from motion itself takes for good to 5 m."""
    place = {"latitude_deg": 48.0, "longitude_deg": 7.0, "altitude_m": 400.0}
    told = Prior(
        source=PriorSource.METADATA,
        altitude_datum=AltitudeDatum.SEA_LEVEL,
        position_sigma_m=0.02,
        **place,
    )
    posed = told.model_copy(update={"yaw_deg": 0.0, "pitch_deg": 0.0, "attitude_sigma_deg": 1.5})
    found = pose_priors(_named(_image(1, told), _image(2, posed)), _ORIGIN)
    assert found is not None
    assert found.position_sigmas(["000001.jpg", "000002.jpg"]).tolist() == [0.02, 0.02]
    assert found.by_name["000002.jpg"].orientation_sigma_deg == 1.5


def test_attitudes_are_passed_on_with_positions() -> None:
    """Also those in the file, which structure from motion itself does not read."""
    seen = _geodetic(1, PriorSource.METADATA)
    assert seen.prior is not None
    level = seen.prior.model_copy(update={"yaw_deg": 90.0, "pitch_deg": 0.0})
    found = pose_priors(_named(_image(1, level), _geodetic(2, PriorSource.METADATA)), _ORIGIN)
    assert found is not None
    rotation = found.by_name["000001.jpg"].rotation
    assert rotation is not None
    np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-9)  # it looks east
    assert found.by_name["000001.jpg"].orientation_sigma_deg > 0
    assert found.by_name["000002.jpg"].rotation is None
    yaw_alone = _image(1, seen.prior.model_copy(update={"yaw_deg": 90.0}))
    assert pose_priors(_named(yaw_alone), _ORIGIN) is None


def test_positions_in_files_alone_are_left_to_structure_from_motion() -> None:
    assert pose_priors(_named(_geodetic(1, PriorSource.METADATA)), _ORIGIN) is None
    assert pose_priors(_named(_image(1, None)), None) is None
    attitude = _image(1, Prior(source=PriorSource.REQUEST, yaw_deg=1.0))
    assert pose_priors(_named(attitude), _ORIGIN) is None


def test_an_update_passes_all_priors_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images = [_local(number) for number in range(3)]
    passed: list[Any] = []
    priors: list[FocalPrior | None] = []

    def add(_names: Any, _monitor: Any, positions: Any, **_: Any) -> None:
        passed.append(positions)
        raise Cancelled("Enough.")

    def open_scene(_folder: Any, _dataset: Any, settings: SceneSettings, *_: Any) -> Any:
        priors.append(settings.sfm.focal_prior)
        return SimpleNamespace(iteration=0, add=add, visited=(), quarantined={})

    prepare: Callable[..., PreparedImages] = lambda *_: PreparedImages(_named(*images), {})  # noqa: E731
    monkeypatch.setattr(scene_jobs, "Scene", SimpleNamespace(open=open_scene))
    monkeypatch.setattr(scene_jobs, "prepare_images", prepare)
    states: Any = SimpleNamespace()
    jobs = scene_jobs.SceneJobs(tmp_path, Blobs(tmp_path / "blobs"), WorkerSettings(), states, states, states)
    request = RunJob(
        job_id="job",
        request=JobRequest(kind=JobKind.UPDATE),
        images=tuple(images),
        camera=CameraPrior(focal_length_px=2000.0, width_px=1600),
        origin=None,
        snapshot_id=None,
    )
    monitor: Any = Monitor()
    with pytest.raises(Cancelled):
        jobs.run(request, monitor)
    assert [list(positions.by_name) for positions in passed] == [["000000.jpg", "000001.jpg", "000002.jpg"]]
    assert priors == [FocalPrior(focal_length_px=2000.0, width_px=1600)]
