import itertools

import pytest
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.host.worker.progress import JobProgress
from fvs_service.jobs.model import JobKind


@pytest.mark.parametrize("kind", JobKind)
def test_progress_never_falls_and_reaches_the_end(kind: JobKind) -> None:
    progress, reached = JobProgress(kind), [0.0]
    stages = ("images", "first model", "features", "matching", "incremental mapping", "global mapping")
    for stage in (*stages, "unheard of", "load", "quick training", "quick snapshot", "train", "snapshot"):
        for share in (0.0, 0.5, 1.0, None):
            progress.add(StageProgress(stage=stage, share=share))
            reached.append(progress.reached)
    assert all(later >= earlier for earlier, later in itertools.pairwise(reached))
    assert reached[-1] == 1.0
