"""Stage two: pairs of images, matched and geometrically verified."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fvs_engine.sfm.colmap.database import (
    count_rows,
    image_ids,
    matched_pairs,
    read_descriptors,
)
from fvs_engine.sfm.jobs import MatchPairs
from fvs_engine.sfm.matching.pairs import exhaustive_pairs, selected_pairs
from fvs_engine.sfm.matching.retrieval import global_descriptors
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_engine.sfm.verification.positions import usable_priors
from fvs_schema.stages import Stage

_BATCH = 400
"""Number of pairs per process after which matching commits: an interruption loses at most these.

Each batch makes an index of the features of each of its images: small ones take longer.
"""


def match_features(stages: Stages, names: Sequence[str], priors: PosePriors | None = None) -> None:
    """Match all pairs of a small set, selected ones of a large set; pairs that are done are skipped.

    Those near in space are selected by ``priors``, by default the positions in the images' metadata.
    """
    database = stages.folder.database
    ids = image_ids(database)
    known = [name for name in names if name in ids]
    exhaustive = len(known) <= stages.settings.exhaustive_up_to
    with stages.timed("pairs"):
        pairs = exhaustive_pairs(len(known)) if exhaustive else _select(stages, known, priors)
    stages.pairs_matched = len(pairs)
    _match(stages, [(known[i], known[j]) for i, j in pairs], ids)


def match_pairs(stages: Stages, pairs: Sequence[tuple[str, str]]) -> None:
    """Match these pairs of image names; pairs that are done are skipped.

    Of a pair that crashes the job the first image is quarantined.
    """
    _match(stages, pairs, image_ids(stages.folder.database))


def _match(stages: Stages, pairs: Sequence[tuple[str, str]], ids: Mapping[str, int]) -> None:
    database = stages.folder.database
    done = matched_pairs(database)
    todo = [pair for pair in pairs if _ordered(ids[pair[0]], ids[pair[1]]) not in done]
    if todo:
        begun = len(done)
        with stages.timed("matching"):
            stages.native_over(
                todo,
                lambda some: MatchPairs(
                    database=database,
                    parts_dir=stages.folder.parts,
                    pair_list=_write_list(stages, some, ids),
                    batch=_BATCH,
                    seed=stages.settings.seed,
                    threads=stages.settings.threads,
                ),
                on_tick=lambda: stages.monitor.report(
                    Stage.MATCHING,
                    min(
                        len(pairs),
                        len(pairs) - len(todo) + _count_matched(stages.folder) - begun,
                    ),
                    len(pairs),
                ),
            )
    stages.monitor.report(Stage.MATCHING, len(pairs), len(pairs))


def _select(stages: Stages, names: Sequence[str], given: PosePriors | None) -> list[tuple[int, int]]:
    database = stages.folder.database
    ids = image_ids(database)
    numbers = [ids[name] for name in names]

    def on_image(done: int) -> None:
        stages.monitor.report(Stage.PAIRS, done, len(names))
        stages.monitor.check()

    descriptors = global_descriptors(
        lambda i: read_descriptors(database, numbers[i]), len(names), stages.settings.seed, on_image
    )
    priors, _ = usable_priors(given, database)
    positions = {
        i: np.array(priors.by_name[name].position) for i, name in enumerate(names) if name in priors.by_name
    }
    return selected_pairs(len(names), descriptors, positions)


def _count_matched(folder: SfmFolder) -> int:
    """The number of pairs matched so far, also while the job runs."""
    databases = (folder.database, *folder.parts.glob("*.db"))
    return sum(count_rows(path, "two_view_geometries") for path in databases)


def _write_list(stages: Stages, pairs: Sequence[tuple[str, str]], ids: Mapping[str, int]) -> Path:
    file = stages.folder.root / "pairs.txt"
    file.write_text("".join(f"{ids[first]} {ids[second]}\n" for first, second in pairs), encoding="ascii")
    return file


def _ordered(first: int, second: int) -> tuple[int, int]:
    return min(first, second), max(first, second)
