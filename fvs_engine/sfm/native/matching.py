"""The native job that matches pairs of images.

Each process matches with one thread. The OpenBLAS in pycolmap is built for OpenMP and is not thread-safe with
COLMAP's threads: concurrent searches occasionally corrupt each other's matches. See
``docs/design/matching.md``.
"""

import math
import os
import shutil
import signal
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pycolmap

from fvs_engine.child_process import kill_with_parent
from fvs_engine.sfm.colmap.database import delete_database
from fvs_engine.sfm.colmap.part_database import Pair, Part, attached, write_part
from fvs_engine.sfm.jobs import MatchPairs, Report

_LEAST_PAIRS = 4
"""Number of pairs below which a further process costs more time than it saves."""


_BLOCK_PAIRS = 50
"""Number of pairs after which COLMAP loads the next images of its list."""


def match(request: MatchPairs, _report: Report) -> None:
    """See ``MatchPairs``."""
    lines = request.pair_list.read_text(encoding="ascii").splitlines()
    pairs = sorted((min(pair), max(pair)) for pair in (tuple(map(int, line.split())) for line in lines))
    most = request.threads or len(os.sched_getaffinity(0))
    folder, size = request.parts_dir, most * request.batch
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(exist_ok=True)
    try:
        for start in range(0, len(pairs), size):
            some = pairs[start : start + size]
            # Unique names: the progress counter may open a part that is just being deleted.
            parts = [
                _Part.of(request.database, folder / f"{start}-{number}.db", share)
                for number, share in enumerate(_shares(some, most))
            ]
            _match_all(parts, request.seed)
            for part in parts:
                part.merge_into(request.database)
                delete_database(part.database)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _shares(pairs: Sequence[Pair], most: int) -> list[Sequence[Pair]]:
    """Split the list into at most ``most`` contiguous runs: the pairs of one image stay together."""
    size = max(_LEAST_PAIRS, math.ceil(len(pairs) / most))
    return [pairs[start : start + size] for start in range(0, len(pairs), size)]


@dataclass(frozen=True)
class _Part:
    """A database with the images of some pairs, which one process matches."""

    database: Path
    pairs: Sequence[Pair]

    @staticmethod
    def of(whole: Path, path: Path, pairs: Sequence[Pair]) -> "_Part":
        """Write cameras, images and features of ``pairs`` into a new database, and matches that exist.

        Images have their ids as names, which COLMAP's list of pairs can hold.
        """
        images = {image_id for pair in pairs for image_id in pair}
        part = Part(images, pairs, ("keypoints", "descriptors"), ("matches",), named_by_id=True)
        write_part(path, whole, part)
        return _Part(path, pairs)

    def match(self, seed: int) -> None:
        """Match and verify the pairs in this process."""
        listed = self.database.with_suffix(".txt")
        listed.write_text("".join(f"{first} {second}\n" for first, second in self.pairs), encoding="ascii")
        pycolmap.set_random_seed(seed)
        matching = pycolmap.FeatureMatchingOptions()
        matching.num_threads = 1
        matching.use_gpu = False
        verification = pycolmap.TwoViewGeometryOptions()
        verification.ransac.random_seed = seed
        verification.compute_relative_pose = True
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = str(listed)
        pairing.block_size = _BLOCK_PAIRS
        pycolmap.match_image_pairs(self.database, matching, pairing, verification)

    def merge_into(self, whole: Path) -> None:
        """Write matches and two-view geometries into the database of all images."""
        with attached(whole, self.database) as db:
            for table in ("matches", "two_view_geometries"):
                db.execute(f"INSERT OR REPLACE INTO {table} SELECT * FROM other.{table}")


def _match_all(parts: Sequence[_Part], seed: int) -> None:
    """Match all parts, each in a process; a single one in this process.

    When one of them crashes, this process ends by the same signal, and the kernel ends the others with it.
    """
    if len(parts) == 1:
        parts[0].match(seed)
        return
    for part in parts:
        _fork(part, seed)
    failed = False
    for _ in parts:
        status = os.waitstatus_to_exitcode(os.wait()[1])
        if status < 0:
            _die_of(-status)
        failed |= status != 0
    if failed:
        raise RuntimeError("a process that matches images failed; its traceback is in the log")


def _die_of(number: int) -> None:
    if number != signal.SIGKILL:  # which has no handler
        signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


def _fork(part: _Part, seed: int) -> None:
    """Match ``part`` in a new process; this one has no threads yet."""
    job = os.getpid()
    if os.fork() != 0:
        return
    kill_with_parent(job)
    try:
        part.match(seed)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)  # skips destructors of C++ libraries, which may hang or crash
