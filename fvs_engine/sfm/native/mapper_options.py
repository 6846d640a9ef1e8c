"""Options of COLMAP's incremental mapper that a request decides."""

from typing import Any

import pycolmap

from fvs_engine.sfm.jobs import AdjustingRequest


def thread_count(threads: int | None) -> int:
    """The number of threads as COLMAP takes it: −1 for one per core."""
    return -1 if threads is None else threads


def mapper_options(request: AdjustingRequest[Any]) -> pycolmap.IncrementalPipelineOptions:
    """The mapper's options with the seed, the threads and what is refined."""
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = request.seed
    options.num_threads = thread_count(request.threads)
    options.ba_refine_focal_length = options.ba_refine_extra_params = request.refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = request.refine
    return options
