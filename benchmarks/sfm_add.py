"""Adding image n + 1 to a standing reconstruction, against structure from motion from nothing.

    python benchmarks/sfm_add.py IMAGES [--transforms FILE | --colmap DIR] [--counts 10 25 49] [--json FILE]

The first ten images (sorted names are the capture order) are bootstrapped, the others added one by one, so
that the standing reconstruction is one that grew. Around every count the time of adding is taken over several
images, and all n + 1 images are reconstructed from nothing in the same run (goals: at 50 adding costs ≤ 1/10
of that, and the added camera is ≤ 1.2 times as far from the truth). Errors are distances of camera centres
after Umeyama over all n + 1 centres, in shares of the spread of the true ones.
"""

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from measurement import Timing, report
from numpy.typing import NDArray

from fvs_engine.geometry import umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.growing import GrowingReconstruction
from fvs_engine.sfm.imports import import_colmap, import_transforms_json
from fvs_engine.sfm.reconstruct import reconstruct
from fvs_engine.sfm.settings import SfmSettings

BOOTSTRAP = 10
TIMED = 5
"""Images whose adding is timed around a count: two before, the one, two after."""

Centres = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Added:
    """One image added: the time it took, where all cameras stood after it."""

    name: str
    seconds: float
    adjusted: bool
    centres: Centres


def truth_of(options: argparse.Namespace) -> Centres:
    if options.transforms is not None:
        return by_file_name(import_transforms_json(options.transforms).centres())
    if options.colmap is not None:
        return by_file_name(import_colmap(options.colmap).centres())
    return {}


def by_file_name(centres: Centres) -> Centres:
    return {Path(name).name: centre for name, centre in centres.items()}


def errors(centres: Centres, truth: Centres) -> dict[str, float]:
    """Name → distance from the truth after Umeyama, in shares of the spread of the true centres."""
    names = sorted(centres.keys() & truth.keys())
    if len(names) < 4:
        return {}
    source = np.stack([centres[name] for name in names])
    target = np.stack([truth[name] for name in names])
    spread = np.sqrt(((target - target.mean(axis=0)) ** 2).sum(axis=1).mean())
    distances = np.linalg.norm(umeyama(source, target).apply(source) - target, axis=1) / spread
    return dict(zip(names, distances.tolist(), strict=True))


def grow(images: Path, names: list[str], folder: Path, settings: SfmSettings) -> list[Added]:
    """Bootstrap with the first ten, add the others one by one."""
    growing = GrowingReconstruction.open(folder, images, settings, Monitor())
    growing.add(names[:BOOTSTRAP], Monitor())
    added = []
    for name in names[BOOTSTRAP:]:
        begun = time.perf_counter()
        change = growing.add([name], Monitor())
        seconds = time.perf_counter() - begun
        print(f"{name}: {seconds:.1f} s, {len(growing.registered)} stand, {change.seconds}", flush=True)
        for warning in change.warnings:
            print(f"  {warning}", flush=True)
        added.append(Added(name, seconds, change.refreshed, growing.reconstruction.centres()))
    return added


def compare(
    count: int, names: list[str], images: Path, added: list[Added], truth: Centres, settings: SfmSettings
) -> dict[str, Any]:
    """A row of the table: image ``count`` + 1 added, and all of them from nothing."""
    position = count - BOOTSTRAP
    around = added[max(position - TIMED // 2, 0) : position + TIMED // 2 + 1]
    seconds = [one.seconds for one in around]
    adding = Timing(min(seconds), median(seconds), max(seconds), len(seconds))
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        scratch = reconstruct(images, names[: count + 1], Path(folder), settings, Monitor())
        from_nothing = time.perf_counter() - begun
    print(f"{count + 1} images from nothing: {from_nothing:.1f} s, {scratch.report.seconds}", flush=True)
    one = added[position]
    ours, theirs = errors(one.centres, truth), errors(scratch.reconstruction.centres(), truth)
    apart = errors(one.centres, scratch.reconstruction.centres())
    row: dict[str, Any] = {
        "n": count,
        "adding one": adding,
        "from nothing, s": round(from_nothing, 1),
        "× faster": from_nothing / adding.median_s,
        "stand": f"{len(one.centres)} / {len(scratch.reconstruction.views)}",
        "apart, %": 100 * apart.get(one.name, float("nan")),
    }
    if truth:
        mine, other = ours.get(one.name, float("nan")), theirs.get(one.name, float("nan"))
        row |= {
            "error added, %": 100 * mine,
            "from nothing, %": 100 * other,
            "ratio": mine / other,
            "median of all, %": 100 * median(ours.values()),
            "from nothing, all, %": 100 * median(theirs.values()),
            "ratio, all": median(ours.values()) / median(theirs.values()),
        }
    return row


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("images", type=Path, help="folder of photographs")
    given = parser.add_mutually_exclusive_group()
    given.add_argument("--transforms", type=Path, help="transforms.json with true poses")
    given.add_argument("--colmap", type=Path, help="COLMAP model with true poses")
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 25, 50])
    parser.add_argument("--keep", type=Path, help="folder of the growing reconstruction (default: none)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    everything = sorted(path.name for path in options.images.iterdir() if path.is_file())
    counts = [count for count in options.counts if BOOTSTRAP <= count < len(everything)]
    names = everything[: max(counts) + 1 + TIMED // 2]
    settings = SfmSettings()
    truth = truth_of(options)
    with tempfile.TemporaryDirectory() as scratch:
        added = grow(options.images, names, options.keep or Path(scratch) / "growing", settings)
    rows = [compare(count, names, options.images, added, truth, settings) for count in counts]
    report(f"sfm-add, {options.images}", rows, options.json)


if __name__ == "__main__":
    main()
