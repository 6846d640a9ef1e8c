import numpy as np
from fvs_service.host.runner.artifacts import _cameras
from fvs_service.host.runner.snapshot_models import views_of

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.views import TrainingView
from fvs_schema.images import Image
from fvs_schema.snapshots import SnapshotCameras


def test_a_snapshot_says_what_share_of_its_images_counts() -> None:
    camera, pose = PinholeCamera(8, 4, 8.0, 8.0, 4.0, 2.0), RigidTransform.identity()
    pixels, mask = np.zeros((4, 8, 3), np.uint8), np.arange(32).reshape(4, 8) < 8
    views = [TrainingView("a", camera, pose, pixels, mask), TrainingView("b", camera, pose, pixels)]
    images = {
        view.name: Image.model_construct(digest=f"sha256:{index:064x}", name=view.name)
        for index, view in enumerate(views)
    }
    written = _cameras(views, images, np.eye(3)).model_dump_json()
    read = views_of(SnapshotCameras.model_validate_json(written))
    assert [view.counted_share for view in read] == [0.25, 1.0]
