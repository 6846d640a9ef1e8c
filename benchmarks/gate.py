"""Calibration of the gate on right and wrong models: its errors, thresholds and receiver characteristics.

    python benchmarks/gate.py DATA --cache FOLDER [--scenes fox bonsai castle-P19 fountain-P11 yard-four ...]
        [--subsets near10far5 ...] [--mapped-only] [--json gate.json]
    python benchmarks/gate.py --cases fox.json bonsai.json ...

Both mappers' models of subsets of each scene (``gate_models``), and models spoilt from them, are examined
without any prior: by the first gate, by one that also knows links between images, and by the present one. An
image is wrong when its centre is more than 10 % of the spread off after a robust alignment; a model is, when
an image that the gate left in it is. Scenes without true poses are judged by an accepted model of all their
photographs. Every threshold is chosen on all scenes but one, and judged on that one.
``FOLDER`` keeps features and models: a second run only examines. ``--cases`` makes the tables of the models
that other runs have written with ``--json``.
"""

import argparse
import json
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from gate_models import MAPPERS, Centres, Scene, map_subset, mapped, mirrored, prepare, spoilt
from gate_tables import DEPTH_ERRORS, SHARES, Case, Judged, characteristics, left_out, summary, thresholds
from measurement import report
from pydantic import TypeAdapter
from yards import YARDS, yard

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import robust_umeyama, umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import MappedModel, registered_names
from fvs_engine.sfm.colmap.database import focal_length_priors, read_keypoints, read_verified_pairs
from fvs_engine.sfm.colmap.model import camera_centres
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import decide
from fvs_engine.sfm.verification.links import Links
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, check_pairs
from fvs_engine.sfm.verification.scale import Scale, depth_ratios

PHOTOGRAPHED = ("fox", "bonsai", "castle-P19", "fountain-P11")
WITHOUT_TRUTH = ("brighton", "caliterra", "kermit", "lund")
"""Scenes with an accepted model of all photographs; that of *banana* is doubtful, *truck11* has none."""
SCENES = (*PHOTOGRAPHED, *WITHOUT_TRUTH, *YARDS)
WRONG_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class VersionEvidence(ModelEvidence):
    """The evidence that one version of the gate has, which has no evidence of the fields ``without``.

    ``known``: all evidence by the images of the model, shared by the versions.
    """

    without: Mapping[str, object] = field(kw_only=True)
    known: dict[tuple[str, ...], Evidence | None] = field(kw_only=True)

    def of(self, model: pycolmap.Reconstruction, monitor: Monitor) -> Evidence | None:
        """The evidence for ``model``, computed once for all versions."""
        images = registered_names(model)
        if images not in self.known:
            self.known[images] = super().of(model, monitor)
        found = self.known[images]
        return None if found is None else found.model_copy(update=dict(self.without))


_NO_FOCALS: Mapping[str, object] = {"unlikely_focal_lengths_px": ()}
_NO_DEPTHS: Mapping[str, object] = {
    **_NO_FOCALS,
    "misscaled_images": (),
    "unscaled_images": (),
    "conflicting_views": (),
}
_VERSIONS: tuple[Mapping[str, object], ...] = (
    {**_NO_DEPTHS, "loosely_linked_images": ()},
    _NO_DEPTHS,
    {},
)
"""What the first gate, that with links and the present one have no evidence of."""

_OPEN: Mapping[str, GateSettings] = {
    "min_match_support": GateSettings(min_match_support=0.0, min_doubtful_match_support=0.0),
    "min_rotation_support": GateSettings(min_rotation_support=0.0),
    "min_translation_support": GateSettings(min_translation_support=0.0),
}
"""Gates without one of the thresholds of support."""


def examine(scene: Scene, cache: Path, only: Sequence[str] | None, mapped_only: bool) -> list[Case]:
    """All cases of a scene."""
    stages = prepare(scene, cache / scene.name / "whole")
    subsets = {name: images for name, images in scene.subsets().items() if only is None or name in only}
    cases = []
    for subset, names in subsets.items():
        folder = map_subset(scene, names, stages.folder, cache / scene.name / subset)
        pairs = read_verified_pairs(folder.database, MIN_PAIR_MATCHES)
        keypoints = read_keypoints(folder.database, {i for pair in pairs for i in (pair.first, pair.second)})
        focal_priors = focal_length_priors(folder.database)
        evidence = ModelEvidence(pairs, keypoints, PosePriors(), focal_priors)
        sound = mapped(folder)
        groups = [sound]
        if sound and not mapped_only:
            # A spoilt model stands alone: the mapper's would show what is wrong with it.
            groups += [{kind: make} for kind, make in spoilt(next(iter(sound.values()))).items()]
        for group in groups:
            cases += _cases(scene, subset, group, evidence)
    return cases


def _cases(
    scene: Scene,
    subset: str,
    group: Mapping[str, Callable[[], pycolmap.Reconstruction]],
    evidence: ModelEvidence,
) -> list[Case]:
    """The cases of models that the gate sees together."""
    wrong = {kind: _wrong(kind, camera_centres(make()), scene.centres) for kind, make in group.items()}
    known: dict[str, dict[tuple[str, ...], Evidence | None]] = {kind: {} for kind in group}
    found = []
    for without in _VERSIONS:
        of = {
            kind: VersionEvidence(
                pairs=evidence.pairs,
                keypoints=evidence.keypoints,
                priors=evidence.priors,
                focal_priors=evidence.focal_priors,
                without=without,
                known=known[kind],
            )
            for kind in group
        }
        found.append(
            [
                MappedModel.of_models(kind, [make()], of[kind], GateSettings(), Monitor())
                for kind, make in group.items()
            ]
        )
    judged = [_judge(scenes, wrong) for scenes in found]
    open_ = {name: _judge(found[2], wrong, settings) for name, settings in _OPEN.items()}
    return [
        Case(
            scene.name,
            subset,
            kind,
            kind in MAPPERS,
            len(camera_centres(make())),
            len(wrong[kind]),
            _link_share(found[0][k], evidence),
            _depth_error(found[1][k].model, evidence),
            _supports(found[2][k].judged.evidence),
            judged[0][k],
            judged[1][k],
            judged[2][k],
            {name: judgements[k] for name, judgements in open_.items()},
        )
        for k, (kind, make) in enumerate(group.items())
    ]


def _judge(
    models: Sequence[MappedModel], wrong: Mapping[str, Set[str]], settings: GateSettings | None = None
) -> list[Judged]:
    judgements = decide([model.judged for model in models], settings or GateSettings()).judgements
    return [
        Judged(
            judgement.verdict,
            len(model.judged.centres.keys() & wrong[model.judged.mapper]),
            (*model.left_out, *model.with_few_points),
        )
        for model, judgement in zip(models, judgements, strict=True)
    ]


def _wrong(kind: str, found: Centres, truth: Centres) -> set[str]:
    # Centres that are nearly in a plane look right in a mirror; the orientations do not.
    if kind == mirrored.__name__:
        return set(found)
    # Most cameras in a row leave the turn about it open, and the others would be far off. Spoilt models are
    # wrong, though, also where all centres are near.
    if kind in MAPPERS and all_near(found, truth):
        return set()
    return wrong_images(found, truth)


def all_near(found: Centres, truth: Centres) -> bool:
    """Whether one alignment brings all centres near the true ones."""
    ours, theirs = (np.stack([centres[name] for name in sorted(found)]) for centres in (found, truth))
    try:
        off = np.linalg.norm(umeyama(ours, theirs).apply(ours) - theirs, axis=1)
    except InvalidInputError:  # all in one place
        return False
    return bool(off.max() <= WRONG_SHARE * centre_spread(theirs))


def wrong_images(found: Centres, truth: Centres) -> set[str]:
    """The images whose centres are far from the true ones, after the alignment that most of them fit."""
    names = sorted(found)
    ours, theirs = (np.stack([centres[name] for name in names]) for centres in (found, truth))
    try:
        moved = robust_umeyama(ours, theirs).transform.apply(ours)
    except InvalidInputError:  # no three of them agree
        return set(names)
    off = np.linalg.norm(moved - theirs, axis=1) / centre_spread(theirs)
    return {name for name, share in zip(names, off, strict=True) if share > WRONG_SHARE}


def _link_share(found: MappedModel, evidence: ModelEvidence) -> float:
    """The largest share at which no image is loose."""
    checks = check_pairs(found.model, evidence.pairs, evidence.keypoints, relative_poses=False)
    # The more a link needs, the more images are loose.
    count = bisect_left(SHARES, True, key=lambda share: bool(Links.of(found.model, checks, share).loose))
    return SHARES[count - 1] if count else 0.0


def _depth_error(model: pycolmap.Reconstruction, evidence: ModelEvidence) -> float:
    ratios = depth_ratios(model, evidence.pairs, evidence.keypoints)
    names = {i: image.name for i, image in model.images.items() if image.has_pose}
    silent = Scale(frozenset(), frozenset())
    confirming = [error for error in DEPTH_ERRORS if Scale.of(names, ratios, error) == silent]
    return min(confirming, default=float("inf"))


def _supports(evidence: Evidence | None) -> dict[str, float | None]:
    """Those of a model, by the names of their thresholds in the settings."""
    return {
        name: None if evidence is None else getattr(evidence, name.removeprefix("min_")) for name in _OPEN
    }


def _scene(data: Path, name: str, cache: Path) -> Scene:
    if name in YARDS:
        return yard(name, cache)
    return Scene.of_all(data, name, cache) if name in WITHOUT_TRUTH else Scene.read(data, name)


def read_cases(paths: Iterable[Path]) -> list[Case]:
    """The models of earlier runs."""
    several = TypeAdapter(list[Case])
    return [
        case
        for path in paths
        for case in several.validate_python(json.loads(path.read_text(encoding="utf-8"))["rows"])
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=SCENES)
    parser.add_argument("--subsets", nargs="+")
    parser.add_argument("--mapped-only", action="store_true", help="leave out the spoilt models")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--cases", type=Path, nargs="+", help="the --json of earlier runs: examine nothing")
    arguments = parser.parse_args()
    if arguments.cases is None and None in (arguments.data, arguments.cache):
        parser.error("give DATA and --cache, or --cases")
    cases = read_cases(arguments.cases or ())
    for name in arguments.scenes if arguments.cases is None else ():
        scene = _scene(arguments.data, name, arguments.cache)
        cases += examine(scene, arguments.cache, arguments.subsets, arguments.mapped_only)
    report("Models", [asdict(case) for case in cases], arguments.json)
    report("Verdicts", summary(cases))
    for threshold in thresholds():
        report(f"{threshold.name}, now {threshold.now}", characteristics(cases, threshold))
        report(f"{threshold.name}: each scene by that of the others", left_out(cases, threshold))


if __name__ == "__main__":
    main()
