"""Depths over three images: the pairs of a row of cameras before a rough wall fit however it is spaced."""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import JudgedModel, Judgement, decide
from fvs_engine.sfm.verification.scale import DepthRatio, Scale, depth_ratios
from fvs_schema.findings import Finding, FindingCode

COUNT = 12
NAMES = {i + 1: f"{i:02}.jpg" for i in range(COUNT)}
LAST_THIRD = tuple(f"{i:02}.jpg" for i in range(8, 12))
NOISE_PX = 0.5
Array = NDArray[np.float64]


def model(places: Sequence[float]) -> pycolmap.Reconstruction:
    """Cameras at ``places`` along the x axis, all looking along z."""
    made = pycolmap.Reconstruction()
    made.add_camera_with_trivial_rig(
        pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 800.0, 1000, 750)
    )
    for (number, name), x in zip(NAMES.items(), places, strict=True):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([-x, 0.0, 0.0]))
        made.add_image_with_trivial_frame(pycolmap.Image(image_id=number, name=name, camera_id=1), pose)
    return made


@functools.cache
def photographed(reach: int) -> tuple[list[VerifiedPair], dict[int, Array]]:
    """Pairs of images at most ``reach`` apart in the true row, one unit apart, and all keypoints."""
    random = np.random.default_rng(0)
    points = random.uniform([-5.0, -3.0, 6.0], [COUNT + 5.0, 3.0, 10.0], size=(1500, 3))
    keypoints, numbers = {}, {}
    for place, i in enumerate(NAMES):
        seen = points - [place, 0.0, 0.0]
        at = seen[:, :2] / seen[:, 2:] * 800.0 + [500.0, 375.0]
        inside = (np.abs(at - [500.0, 375.0]) < [500.0, 375.0]).all(axis=1)
        keypoints[i] = at[inside] + random.normal(scale=NOISE_PX, size=(int(inside.sum()), 2))
        numbers[i] = np.flatnonzero(inside)
    pairs = []
    for i in NAMES:
        for j in range(i + 1, min(i + reach, COUNT) + 1):
            _, first, second = np.intersect1d(numbers[i], numbers[j], return_indices=True)
            pairs.append(VerifiedPair(i, j, np.stack([first, second], axis=1).astype(np.uint32)))
    return pairs, keypoints


RIGHT = [float(i) for i in range(COUNT)]


def shifted(share: float) -> list[float]:
    """The last third further along the row, by a share of the spread of the cameras."""
    return [x + (share * float(np.std(RIGHT)) if i >= 8 else 0.0) for i, x in enumerate(RIGHT)]


def scale(places: Sequence[float], reach: int = 4) -> Scale:
    return Scale.of(NAMES, depth_ratios(model(places), *photographed(reach)))


def judged(places: Sequence[float], reach: int = 4) -> tuple[Judgement, Evidence]:
    made = model(places)
    evidence = ModelEvidence(*photographed(reach), PosePriors()).of(made, Monitor())
    assert evidence is not None
    centres = {image.name: np.asarray(image.projection_center()) for image in made.images.values()}
    decision = decide([JudgedModel("incremental", centres, evidence)], GateSettings())
    return decision.judgements[0], evidence


def test_a_right_row_is_accepted():
    judgement, evidence = judged(RIGHT)
    assert judgement.verdict == "accepted"
    assert evidence.misscaled_images == evidence.unscaled_images == ()


@pytest.mark.parametrize("share", [0.1, -0.2])
def test_a_row_whose_last_third_is_shifted_is_rejected_by_name_though_all_pairs_fit(share: float):
    judgement, evidence = judged(shifted(share))
    assert evidence.match_support > 0.99
    assert evidence.translation_support is not None
    assert evidence.translation_support > 0.99
    assert evidence.unsupported_images == ()
    assert evidence.misscaled_images == LAST_THIRD
    assert judgement.verdict == "rejected"
    assert "08.jpg" in judgement.reasons[0].images


@pytest.mark.parametrize("place", [0, 5, 11])
def test_one_image_that_slid_along_the_row_is_named(place: int):
    found = scale([x + (0.4 if i == place else 0.0) for i, x in enumerate(RIGHT)])
    assert found == Scale(frozenset((f"{place:02}.jpg",)), frozenset())


def test_the_part_beyond_the_place_where_a_row_is_stretched_is_named():
    found = scale([x if i <= 8 else 8 + 1.3 * (x - 8) for i, x in enumerate(RIGHT)])
    assert found.contradicted == set(LAST_THIRD[1:])


def test_a_scale_of_the_whole_is_no_contradiction():
    assert scale([7.0 * x for x in RIGHT]) == Scale(frozenset(), frozenset())


def test_a_new_image_that_slid_along_the_row_is_contradicted_and_no_right_one():
    check = PoseCheck(*photographed(4), 0.75, PosePriors())
    slid = model([x + (0.4 if i == 11 else 0.0) for i, x in enumerate(RIGHT)])
    assert check.contradiction(slid, 12) == Finding.of(FindingCode.POSE_AT_WRONG_DISTANCE, ["11.jpg"])
    right = model(RIGHT)
    assert [check.contradiction(right, i) for i in NAMES] == COUNT * [None]
    assert check.unscaled(right, list(NAMES.values())) == []


def test_depths_are_compared_once_for_the_same_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[int] = []

    def observed(*given: Any) -> list[DepthRatio]:
        compared.append(1)
        return depth_ratios(*given)

    monkeypatch.setattr("fvs_engine.sfm.native.pose_check.depth_ratios", observed)
    check = PoseCheck(*photographed(4), 0.75, PosePriors())
    assert check.contradiction(model(RIGHT), 12) is None
    assert check.unscaled(model(RIGHT), ["11.jpg"]) == []
    assert len(compared) == 1
    slid = model([x + (0.4 if i == 11 else 0.0) for i, x in enumerate(RIGHT)])
    assert check.contradiction(slid, 12) is not None
    slid.camera(1).params = slid.camera(1).params * [1.5, 1.0, 1.0]
    check.unscaled(slid, ["11.jpg"])
    assert len(compared) == 3


def test_a_new_image_that_one_pair_joins_with_the_rest_is_unscaled():
    pairs, keypoints = photographed(4)
    last = [pair for pair in pairs if pair.second < 12 or pair.first == 11]
    own = last[-1].matches[:200]
    kept = [VerifiedPair(p.first, p.second, p.matches[~_uses(p, own, 11, 12)]) for p in last[:-1]]
    check = PoseCheck([*kept, VerifiedPair(11, 12, own)], keypoints, 0.75, PosePriors())
    assert check.contradiction(model(RIGHT), 12) is None
    assert check.unscaled(model(RIGHT), ["05.jpg", "11.jpg"]) == ["11.jpg"]


def test_distances_that_no_three_images_show_are_doubtful():
    pairs, keypoints = photographed(4)
    # Of the pairs across the gap one is left, with features that no other pair has.
    across = next(pair.matches[:200] for pair in pairs if (pair.first, pair.second) == (8, 9))
    kept = [
        VerifiedPair(pair.first, pair.second, pair.matches[~_uses(pair, across, 8, 9)])
        for pair in pairs
        if not pair.first <= 8 < pair.second
    ]
    pairs = [*kept, VerifiedPair(8, 9, across)]
    for places in (RIGHT, shifted(0.3)):
        made = model(places)
        assert Scale.of(NAMES, depth_ratios(made, pairs, keypoints)) == Scale(
            frozenset(), frozenset(LAST_THIRD)
        )


def _uses(pair: VerifiedPair, own: NDArray[np.uint32], first: int, second: int) -> NDArray[np.bool_]:
    """Which matches of a pair use a feature of ``own``, the matches of images ``first`` and ``second``."""
    used = np.zeros(len(pair.matches), dtype=bool)
    for image, column in ((first, 0), (second, 1)):
        for side, end in enumerate((pair.first, pair.second)):
            if end == image:
                used |= np.isin(pair.matches[:, side], own[:, column])
    return used


def test_false_matches_of_three_images_are_no_evidence():
    pairs, keypoints = photographed(4)
    random = np.random.default_rng(1)
    # The pairs 1-12 and 2-12 look alike: every match is along the epipolar lines, at any depth.
    false = []
    for first in (1, 2):
        rows = random.permutation(len(keypoints[first]))[:300]
        order = np.argsort(keypoints[12][:, 1])
        near = np.searchsorted(keypoints[12][order, 1], keypoints[first][rows, 1]).clip(0, len(order) - 1)
        false.append(VerifiedPair(first, 12, np.stack([rows, order[near]], axis=1).astype(np.uint32)))
    assert Scale.of(NAMES, depth_ratios(model(RIGHT), [*pairs, *false], keypoints)) == Scale(
        frozenset(), frozenset()
    )


def test_two_images_have_no_distance_to_compare():
    names = dict(list(NAMES.items())[:2])
    assert Scale.of(names, []) == Scale(frozenset(), frozenset())


def test_three_images_in_a_chain_of_pairs_are_open():
    names = dict(list(NAMES.items())[:3])
    assert Scale.of(names, []).open == set(names.values())


def test_groups_that_share_two_images_have_one_scale():
    """An image between two of the rest, whose features no third of the rest sees, is fixed by those two."""
    names = dict(list(NAMES.items())[:6])
    chain = [DepthRatio(i, i - 1, i + 1, 0.0, 0.01) for i in (2, 3, 4)]
    between = DepthRatio(6, 3, 4, 0.0, 0.01)
    beside = DepthRatio(6, 5, 5, 0.0, 0.01)
    assert Scale.of(names, [*chain, between]).open == set()
    assert Scale.of(names, [*chain, beside]).open == {names[6]}
