"""Calibration of the gate on right and wrong models: its errors, thresholds and receiver characteristics.

    python benchmarks/gate.py DATA --cache FOLDER [--scenes fox bonsai castle-P19 fountain-P11 yard-four ...]
        [--subsets near10far5 ...] [--mapped-only] [--json gate.json]

Both mappers' models of subsets of each scene (``gate_models``), and models spoilt from them, are examined
without any prior: by the gate of ADR 2, by that of ADR 27, whose evidence is of pairs, and by the present
one, without the witness, and with it where the extra aliked is installed. An image is wrong when its centre
is more than 10 % of the spread off after a robust alignment; a model is, when an image that the gate left in
it is. The thresholds of loosely linked images and of depths are chosen on all scenes but one, and judged on
that one.
``FOLDER`` keeps features and models: a second run only examines.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pycolmap
from gate_models import Centres, Scene, map_subset, mapped, mirrored, prepare, spoilt
from measurement import report
from yards import YARDS, yard

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import MappedScene, ModelEvidence, registered_names
from fvs_engine.sfm.colmap.database import read_keypoints, read_verified_pairs
from fvs_engine.sfm.matching.witness import ask_witness
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence, Verdict
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.gate import Candidate, decide
from fvs_engine.sfm.verification.links import MIN_LINK_SHARE, Links
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, check_pairs
from fvs_engine.sfm.verification.scale import MAX_DEPTH_ERROR, Scale, depth_ratios
from fvs_engine.sfm.verification.witness import WitnessMatches

PHOTOGRAPHED = ("fox", "bonsai", "castle-P19", "fountain-P11")
SCENES = (*PHOTOGRAPHED, *YARDS)
WRONG_SHARE = 0.1
SHARES = np.arange(0.005, 0.0501, 0.0025)
"""Candidates for the threshold of loosely linked images."""
DEPTH_ERRORS = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)
"""Candidates for the threshold of depths that disagree."""


@dataclass(frozen=True)
class Judged:
    """A model by one version of the gate: its verdict, and the number of wrong images that it left in."""

    verdict: Verdict
    wrong: int


@dataclass(frozen=True)
class Case:
    """A model, of whose ``images`` some are ``wrong``, and how the versions of the gate judge it."""

    scene: str
    subset: str
    kind: str
    images: int
    wrong: int
    link_share: float
    """The largest of ``SHARES`` that leaves no image loosely linked; 0 when all do."""
    depth_error: float
    """The smallest of ``DEPTH_ERRORS`` by which depths confirm all distances; infinite when none does."""
    before: Judged
    pairs: Judged
    pairs_witness: Judged | None
    without: Judged
    witness: Judged | None


@dataclass(frozen=True, eq=False)
class VersionEvidence(ModelEvidence):
    """The evidence that one version of the gate has, which has no evidence of the fields ``without``.

    ``known``: all evidence by the images of the model, shared by the versions.
    """

    without: Mapping[str, object] = field(default_factory=dict)
    known: dict[tuple[str, ...], Evidence | None] = field(default_factory=dict)

    def of(self, model: pycolmap.Reconstruction, monitor: Monitor) -> Evidence | None:
        """The evidence for ``model``, computed once for all versions."""
        images = registered_names(model)
        if images not in self.known:
            self.known[images] = super().of(model, monitor)
        found = self.known[images]
        return None if found is None else found.model_copy(update=dict(self.without))


_NO_DEPTHS: Mapping[str, object] = {"misscaled_images": (), "unscaled_images": ()}
_NO_WITNESS: Mapping[str, object] = {"witness": None}
_VERSIONS: tuple[Mapping[str, object], ...] = (
    {**_NO_DEPTHS, **_NO_WITNESS, "loosely_linked_images": ()},
    {**_NO_DEPTHS, **_NO_WITNESS},
    _NO_WITNESS,
    _NO_DEPTHS,
    {},
)
"""What the gates of ADR 2 and 27 and the present one have no evidence of; the last two have the witness."""


def examine(scene: Scene, cache: Path, only: Sequence[str] | None, mapped_only: bool) -> list[Case]:
    """All cases of a scene."""
    stages = prepare(scene, cache / scene.name / "whole")
    subsets = {name: images for name, images in scene.subsets().items() if only is None or name in only}
    matches = ask_witness(stages, scene.image_dir, {image for images in subsets.values() for image in images})
    cases = []
    for subset, names in subsets.items():
        folder = map_subset(scene, names, stages.folder, cache / scene.name / subset)
        pairs = read_verified_pairs(folder.database, MIN_PAIR_MATCHES)
        keypoints = read_keypoints(folder.database, {i for pair in pairs for i in (pair.first, pair.second)})
        evidence = ModelEvidence(pairs, keypoints, PosePriors())
        if matches is not None:
            evidence = replace(evidence, witness=partial(_unchanged, matches))
        sound = mapped(folder)
        groups = [sound]
        if sound and not mapped_only:
            # A spoilt model stands alone: the mapper's would show what is wrong with it.
            groups += [{kind: make} for kind, make in spoilt(next(iter(sound.values()))).items()]
        for group in groups:
            cases += _cases(scene, subset, group, evidence, matches is not None)
    return cases


def _unchanged(matches: WitnessMatches) -> WitnessMatches:
    return matches


def _cases(
    scene: Scene,
    subset: str,
    group: Mapping[str, Callable[[], pycolmap.Reconstruction]],
    evidence: ModelEvidence,
    witness: bool,
) -> list[Case]:
    """The cases of models that the gate sees together; ``witness``: whether there is one."""
    wrong = {kind: _wrong(kind, _centres(make()), scene.centres) for kind, make in group.items()}
    known: dict[str, dict[tuple[str, ...], Evidence | None]] = {kind: {} for kind in group}
    judged = []
    for without in _VERSIONS if witness else _VERSIONS[:3]:
        of = {
            kind: VersionEvidence(
                evidence.pairs, evidence.keypoints, evidence.priors, evidence.witness, without, known[kind]
            )
            for kind in group
        }
        found = [MappedScene.of_models(kind, [make()], of[kind], Monitor()) for kind, make in group.items()]
        judged.append(_judge([scene.candidate for scene in found], wrong))
    return [
        Case(
            scene.name,
            subset,
            kind,
            len(_centres(make())),
            len(wrong[kind]),
            _link_share(make(), evidence),
            _depth_error(make(), evidence),
            judged[0][k],
            judged[1][k],
            judged[3][k] if witness else None,
            judged[2][k],
            judged[4][k] if witness else None,
        )
        for k, (kind, make) in enumerate(group.items())
    ]


def _judge(candidates: Sequence[Candidate], wrong: Mapping[str, Set[str]]) -> list[Judged]:
    judgements = decide(candidates, GateSettings()).judgements
    return [
        Judged(judgement.verdict, len(candidate.centres.keys() & wrong[candidate.mapper]))
        for candidate, judgement in zip(candidates, judgements, strict=True)
    ]


def _centres(model: pycolmap.Reconstruction) -> Centres:
    return {image.name: image.projection_center() for image in model.images.values() if image.has_pose}


def _wrong(kind: str, found: Centres, truth: Centres) -> set[str]:
    # Centres that are nearly in a plane look right in a mirror; the orientations do not.
    return set(found) if kind == mirrored.__name__ else wrong_images(found, truth)


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


def _link_share(model: pycolmap.Reconstruction, evidence: ModelEvidence) -> float:
    checks = check_pairs(model, evidence.pairs, evidence.keypoints, relative_poses=False)
    fitting = [share for share in SHARES if not Links.of(model, checks, share).loose]
    return float(max(fitting, default=0.0))


def _depth_error(model: pycolmap.Reconstruction, evidence: ModelEvidence) -> float:
    ratios = depth_ratios(model, evidence.pairs, evidence.keypoints)
    names = {i: image.name for i, image in model.images.items() if image.has_pose}
    silent = Scale(frozenset(), frozenset())
    return next((error for error in DEPTH_ERRORS if Scale.of(names, ratios, error) == silent), float("inf"))


def summary(cases: Sequence[Case]) -> list[dict[str, object]]:
    """False accepts, doubts and refusals of every version of the gate, scene by scene."""
    versions: dict[str, Callable[[Case], Judged | None]] = {
        "ADR 2": lambda case: case.before,
        "ADR 27, no witness": lambda case: case.pairs,
        "ADR 27, witness": lambda case: case.pairs_witness,
        "now, no witness": lambda case: case.without,
        "now, witness": lambda case: case.witness,
    }
    rows = []
    for scene in (*dict.fromkeys(case.scene for case in cases), "all"):
        for name, judged in versions.items():
            of = [(case, judged(case)) for case in cases if scene in (case.scene, "all")]
            seen = [(case, one) for case, one in of if one is not None]
            sound = [one for case, one in seen if case.wrong == 0]
            bad = [one for case, one in seen if case.wrong > 0]
            if seen:
                rows.append(
                    {
                        "scene": scene,
                        "gate": name,
                        "right": len(sound),
                        "accepted": sum(one.verdict == "accepted" for one in sound),
                        "doubtful": sum(one.verdict == "doubtful" for one in sound),
                        "refused": sum(one.verdict == "rejected" for one in sound),
                        "wrong": len(bad),
                        "wrong accepted": sum(one.verdict == "accepted" and one.wrong > 0 for one in bad),
                        "cleaned": sum(one.verdict != "rejected" and one.wrong == 0 for one in bad),
                        "wrong doubtful": sum(one.verdict == "doubtful" and one.wrong > 0 for one in bad),
                        "wrong refused": sum(one.verdict == "rejected" for one in bad),
                    }
                )
    return rows


def threshold(cases: Sequence[Case]) -> float:
    """The smallest share at which every wrong model that the gate of ADR 2 accepts has a loose image."""
    passed = [
        case.link_share for case in cases if case.before.verdict == "accepted" and case.before.wrong > 0
    ]
    return float(min((share for share in SHARES if share > max(passed, default=0.0)), default=SHARES[-1]))


def characteristics(cases: Sequence[Case]) -> list[dict[str, object]]:
    """What each threshold doubts, of the models that the gate of ADR 2 accepts."""
    accepted = [case for case in cases if case.before.verdict == "accepted"]
    right, wrong = ([c for c in accepted if (c.before.wrong > 0) == bad] for bad in (False, True))
    return [
        {
            "least share": float(share),
            "right doubted": f"{sum(case.link_share < share for case in right)} of {len(right)}",
            "wrong doubted": f"{sum(case.link_share < share for case in wrong)} of {len(wrong)}",
        }
        for share in SHARES
    ]


def left_out(cases: Sequence[Case]) -> list[dict[str, object]]:
    """For each scene: the threshold that the other scenes give, and its errors on this one."""
    rows = []
    for scene in dict.fromkeys(case.scene for case in cases):
        share = threshold([case for case in cases if case.scene != scene])
        own = [case for case in cases if case.scene == scene and case.before.verdict == "accepted"]
        rows.append(
            {
                "left out": scene,
                "least share": share,
                "wrong accepted": sum(c.before.wrong > 0 and c.link_share >= share for c in own),
                "right doubted": sum(c.before.wrong == 0 and c.link_share < share for c in own),
                "right": sum(c.before.wrong == 0 for c in own),
            }
        )
    return rows


def depth_threshold(cases: Sequence[Case]) -> float:
    """The largest error at which depths doubt every wrong model that the pairs accept."""
    passed = [case.depth_error for case in _accepted_by_pairs(cases) if case.pairs.wrong > 0]
    return max((error for error in DEPTH_ERRORS if error < min(passed, default=np.inf)), default=0.0)


def depth_characteristics(cases: Sequence[Case]) -> list[dict[str, object]]:
    """What each threshold of depths doubts, of the models that the pairs accept."""
    accepted = _accepted_by_pairs(cases)
    right, wrong = [c for c in accepted if c.wrong == 0], [c for c in accepted if c.pairs.wrong > 0]
    return [
        {
            "greatest error": error,
            "right doubted": f"{sum(case.depth_error > error for case in right)} of {len(right)}",
            "wrong doubted": f"{sum(case.depth_error > error for case in wrong)} of {len(wrong)}",
        }
        for error in DEPTH_ERRORS
    ]


def depths_left_out(cases: Sequence[Case]) -> list[dict[str, object]]:
    """For each scene: the threshold of depths that the other scenes give, and its errors on this one."""
    rows = []
    for scene in dict.fromkeys(case.scene for case in cases):
        error = depth_threshold([case for case in cases if case.scene != scene])
        own = [case for case in _accepted_by_pairs(cases) if case.scene == scene]
        rows.append(
            {
                "left out": scene,
                "greatest error": error,
                "wrong accepted": sum(c.pairs.wrong > 0 and c.depth_error <= error for c in own),
                "wrong": sum(c.pairs.wrong > 0 for c in own),
                "right doubted": sum(c.wrong == 0 and c.depth_error > error for c in own),
                "right": sum(c.wrong == 0 for c in own),
            }
        )
    return rows


def _accepted_by_pairs(cases: Sequence[Case]) -> list[Case]:
    return [case for case in cases if case.pairs.verdict == "accepted"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=SCENES)
    parser.add_argument("--subsets", nargs="+")
    parser.add_argument("--mapped-only", action="store_true", help="leave out the spoilt models")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    cases = []
    for name in arguments.scenes:
        scene = yard(name, arguments.cache) if name in YARDS else Scene.read(arguments.data, name)
        cases += examine(scene, arguments.cache, arguments.subsets, arguments.mapped_only)
    report("Models", [asdict(case) for case in cases], arguments.json)
    report("Verdicts", summary(cases))
    report(f"Threshold of loose links, now {MIN_LINK_SHARE}", characteristics(cases))
    report("Each scene by the threshold of the others", left_out(cases))
    report(f"Threshold of depths, now {MAX_DEPTH_ERROR}", depth_characteristics(cases))
    report("Each scene by the threshold of the others", depths_left_out(cases))


if __name__ == "__main__":
    main()
