"""The gate on evidence made by hand, and on a real model whose poses were spoilt as a mapper would."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import MappedModel
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import read_keypoints, read_verified_pairs
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import Decision, JudgedModel, decide
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES
from fvs_engine.wording import sentence
from fvs_schema.findings import Finding, FindingCode, Severity

SETTINGS = GateSettings()
NAMES = [f"{i}.jpg" for i in range(12)]


def evidence(**changes: object) -> Evidence:
    good = Evidence(
        pairs=60,
        matches=6000,
        match_support=0.97,
        rotation_support=0.95,
        translation_support=0.95,
        cycle_consistency=0.9,
        unsupported_images=(),
        loosely_linked_images=(),
        misscaled_images=(),
        unscaled_images=(),
        conflicting_views=(),
        unlikely_focal_lengths_px=(),
        misplaced_images=(),
        prior_residual_share=None,
        prior_support=None,
    )
    return Evidence.model_validate(good.model_dump() | changes)


def centres(seed: int = 0) -> dict[str, NDArray[np.float64]]:
    return dict(zip(NAMES, np.random.default_rng(seed).normal(size=(len(NAMES), 3)), strict=True))


def model(mapper: str, seed: int = 0, **changes: object) -> JudgedModel:
    return JudgedModel(mapper, centres(seed), evidence(**changes))


def test_the_better_supported_of_two_that_disagree_is_chosen():
    decision = decide(
        [model("global", seed=1, match_support=0.75), model("incremental", match_support=0.95)],
        SETTINGS,
    )
    assert decision.chosen == 1
    assert [judgement.verdict for judgement in decision.judgements] == ["rejected", "accepted"]
    assert decision.warnings == ()


def test_more_registered_images_do_not_win():
    partial = model("incremental", match_support=0.97, pairs=40, matches=4000)
    keep = dict(list(centres().items())[:9])
    partial = JudgedModel("incremental", keep, partial.evidence)
    decision = decide([model("global", seed=1, match_support=0.8), partial], SETTINGS)
    assert decision.chosen == 1


def _codes(findings: tuple[Finding, ...]) -> list[FindingCode]:
    return [finding.code for finding in findings]


def test_the_larger_of_two_right_models_wins():
    partial = JudgedModel("incremental", dict(list(centres().items())[:6]), evidence(pairs=15, matches=1500))
    decision = decide([partial, model("global", match_support=0.965)], SETTINGS)
    assert decision.chosen == 1


def test_weak_support_needs_a_second_mapper_and_warns_loudly():
    alone = decide([model("incremental", match_support=0.87)], SETTINGS)
    assert alone.chosen is None
    both = decide([model("incremental", match_support=0.87), model("global", match_support=0.86)], SETTINGS)
    assert both.chosen == 0
    assert both.judgements[0].verdict == "doubtful"
    assert {warning.severity for warning in both.warnings} == {Severity.DOUBT}


def test_a_model_with_a_wrong_focal_length_must_be_confirmed_for_its_directions():
    """Evidence that incremental mapping of a real orbit had with a focal length a third too short."""
    squeezed = {"match_support": 0.901, "rotation_support": 0.941, "translation_support": 0.215}
    alone = decide([model("incremental", **squeezed)], SETTINGS)
    assert alone.chosen is None
    assert _codes(alone.judgements[0].reasons) == [FindingCode.DIRECTION_SUPPORT, FindingCode.UNCONFIRMED]
    assert alone.judgements[0].reasons[0].numbers == {"support": 0.215}
    beside_the_right_one = decide([model("incremental", **squeezed), model("global", 1)], SETTINGS)
    assert [judged.verdict for judged in beside_the_right_one.judgements] == ["rejected", "accepted"]
    assert beside_the_right_one.warnings == ()


def test_weak_directions_are_usable_when_another_mapper_confirms_the_model():
    both = [model(mapper, translation_support=0.7) for mapper in ("incremental", "global")]
    decision = decide(both, SETTINGS)
    assert decision.chosen is not None
    assert decision.judgements[decision.chosen].verdict == "doubtful"
    weak, confirmed = decision.warnings
    assert weak.code is FindingCode.DIRECTION_SUPPORT
    assert confirmed.texts == {"source": "another mapper"}


def test_gps_confirms_as_another_mapper_does_but_saves_nobody():
    near = decide([model("global", match_support=0.87, prior_residual_share=0.08)], SETTINGS)
    assert near.judgements[0].verdict == "doubtful"
    assert near.warnings[1].texts == {"source": "GPS"}
    vague = decide([model("global", match_support=0.87, prior_residual_share=0.2)], SETTINGS)
    assert vague.chosen is None
    unsupported = decide([model("global", match_support=0.8, prior_residual_share=0.01)], SETTINGS)
    assert unsupported.chosen is None


def test_two_accepted_images_are_no_match_for_a_doubtful_whole():
    pair = JudgedModel(
        "incremental", dict(list(centres().items())[:2]), evidence(pairs=1, matches=40, match_support=1.0)
    )
    whole = model("global", match_support=0.88, prior_residual_share=0.05)
    decision = decide([pair, whole], SETTINGS)
    assert [judgement.verdict for judgement in decision.judgements] == ["accepted", "doubtful"]
    assert decision.chosen == 1
    assert decision.warnings


def test_two_mappers_misled_to_the_same_place_are_rejected_all_the_same():
    decision = decide([model("incremental", match_support=0.7), model("global", match_support=0.7)], SETTINGS)
    assert decision.chosen is None


def test_equally_supported_models_that_contradict_are_doubtful():
    decision = decide([model("incremental"), model("global", seed=1)], SETTINGS)
    assert decision.chosen is not None
    assert decision.judgements[decision.chosen].verdict == "doubtful"
    assert decision.warnings


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"rotation_support": 0.6}, FindingCode.ROTATION_SUPPORT),
        ({"unsupported_images": tuple(NAMES[:3])}, FindingCode.CONTRADICTED_POSES),
        ({"prior_residual_share": 0.5}, FindingCode.CENTRES_OFF_PRIORS),
        ({"prior_residual_share": 0.5, "prior_support": 0.8}, FindingCode.CENTRES_OFF_PRIORS),
        ({"misplaced_images": tuple(NAMES[:5]), "prior_support": 0.8}, FindingCode.FAR_FROM_PRIORS),
    ],
)
def test_each_kind_of_evidence_can_reject_alone(changes: dict[str, object], reason: FindingCode):
    decision = decide([model("incremental", **changes)], SETTINGS)
    assert decision.chosen is None
    (found,) = decision.judgements[0].reasons
    assert (found.code, found.severity) == (reason, Severity.REJECTION)
    assert found.images == tuple(changes.get("unsupported_images", changes.get("misplaced_images", ())))


@pytest.mark.parametrize(
    "contradiction", [{"prior_residual_share": 0.5}, {"misplaced_images": tuple(NAMES[:5])}]
)
def test_priors_that_the_pairs_contradict_too_reject_no_model(contradiction: dict[str, object]):
    decision = decide([model("incremental", prior_support=0.3, **contradiction)], SETTINGS)
    assert decision.judgements[0].verdict == "accepted"
    assert decision.warnings == (Finding.of(FindingCode.POSITIONS_IGNORED),)


def test_priors_that_the_pairs_contradict_confirm_no_model():
    weak = {"match_support": 0.87, "prior_residual_share": 0.05}
    assert decide([model("incremental", **weak)], SETTINGS).chosen == 0
    assert decide([model("incremental", prior_support=0.3, **weak)], SETTINGS).chosen is None


FEW = tuple(NAMES[:2])
"""Images that few matches link to the rest."""


def test_images_that_few_matches_join_are_doubtful_and_need_no_second_mapper():
    decision = decide([model("incremental", loosely_linked_images=FEW)], SETTINGS)
    assert decision.judgements[0].verdict == "doubtful"
    assert decision.warnings == (Finding.of(FindingCode.LOOSELY_LINKED, FEW, Severity.DOUBT),)


def test_gps_ends_the_doubt_about_few_matches():
    decision = decide([model("incremental", loosely_linked_images=FEW, prior_residual_share=0.05)], SETTINGS)
    assert decision.judgements[0].verdict == "accepted"


@pytest.mark.parametrize("weakness", ["loosely_linked_images", "unscaled_images"])
def test_gps_says_nothing_of_images_without_it(weakness: str):
    """As of those whose positions a frozen receiver repeated: three of 19 were wrong, and accepted."""
    gps = {"prior_residual_share": 0.02, "images_without_prior": NAMES[1:5]}
    decision = decide([model("incremental", **gps, **{weakness: FEW})], SETTINGS)
    assert decision.judgements[0].verdict == "doubtful"
    assert decision.warnings[0].images == ("1.jpg",)
    decision = decide([model("incremental", **gps, **{weakness: FEW[:1]})], SETTINGS)
    assert decision.judgements[0].verdict == "accepted"


def test_images_that_matches_contradict_are_doubtful_where_gps_confirms_them():
    """As of 20 views, all right, of a wall with a repeated pattern: matches contradicted four of them."""
    gps = {"prior_residual_share": 0.03, "unsupported_images": NAMES[:4]}
    (judgement,) = decide([model("incremental", **gps)], SETTINGS).judgements
    assert judgement.verdict == "doubtful"
    assert (len(judgement.reasons[0].images), judgement.reasons[0].numbers) == (4, {"of": 12})
    elsewhere = decide([model("incremental", images_without_prior=NAMES[:4], **gps)], SETTINGS)
    assert elsewhere.judgements[0].verdict == "rejected"
    far = decide([model("incremental", **gps | {"prior_residual_share": 0.15})], SETTINGS)
    assert far.judgements[0].verdict == "rejected"


def test_a_model_with_distances_that_depths_contradict_is_never_accepted():
    many = decide([model("incremental", misscaled_images=NAMES[:3])], SETTINGS)
    assert many.chosen is None
    wrong = FindingCode.WRONG_DISTANCE
    assert many.judgements[0].reasons == (Finding.of(wrong, NAMES[:3], Severity.REJECTION),)
    one = decide([model("incremental", misscaled_images=NAMES[:1], prior_residual_share=0.05)], SETTINGS)
    assert one.judgements[0].verdict == "doubtful"
    assert one.warnings == (Finding.of(wrong, NAMES[:1], Severity.DOUBT),)


def test_distances_that_nothing_confirms_are_doubtful_unless_gps_does():
    decision = decide([model("incremental", unscaled_images=FEW)], SETTINGS)
    assert decision.judgements[0].verdict == "doubtful"
    assert decision.warnings == (Finding.of(FindingCode.UNKNOWN_DISTANCE, FEW, Severity.DOUBT),)
    decision = decide([model("incremental", unscaled_images=FEW, prior_residual_share=0.05)], SETTINGS)
    assert decision.judgements[0].verdict == "accepted"


@pytest.mark.parametrize(("without_prior", "verdict"), [((), "accepted"), (NAMES[:1], "doubtful")])
def test_images_that_should_show_the_same_and_do_not_are_doubtful_unless_gps_confirms_both(
    without_prior: list[str], verdict: str
):
    conflicting = (("0.jpg", "5.jpg"),)
    decision = decide([model("incremental", conflicting_views=conflicting)], SETTINGS)
    assert decision.judgements[0].verdict == "doubtful"
    assert sentence(decision.warnings[0]).startswith("DOUBTFUL CAMERAS: 0.jpg and 5.jpg should overlap")
    gps = {"prior_residual_share": 0.05, "images_without_prior": tuple(without_prior)}
    decision = decide([model("incremental", conflicting_views=conflicting, **gps)], SETTINGS)
    assert decision.judgements[0].verdict == verdict


def test_an_unlikely_focal_length_is_doubtful_unless_gps_confirms_the_model():
    decision = decide([model("incremental", unlikely_focal_lengths_px=(96.9,))], SETTINGS)
    assert decision.judgements[0].verdict == "doubtful"
    assert decision.warnings[0].code is FindingCode.UNLIKELY_FOCAL_LENGTH
    assert decision.warnings[0].texts == {"focal_px": "97"}
    gps = model("incremental", unlikely_focal_lengths_px=(96.9,), prior_residual_share=0.05)
    assert decide([gps], SETTINGS).judgements[0].verdict == "accepted"


def test_a_doubt_about_distances_saves_no_weak_model():
    weak = model("incremental", match_support=0.87, unscaled_images=FEW)
    assert decide([weak], SETTINGS).chosen is None


def test_a_model_without_verified_pairs_is_rejected():
    assert decide([JudgedModel("global", centres(), None)], SETTINGS).chosen is None


def test_agreement_ignores_the_frame():
    moved = {name: 3.0 * centre[[1, 2, 0]] + 5.0 for name, centre in centres().items()}
    decision = decide([model("incremental"), JudgedModel("global", moved, evidence())], SETTINGS)
    assert decision.agreements[0].median_share < 1e-9
    assert decision.judgements[0].verdict == "accepted"


def examined(model: pycolmap.Reconstruction, folder: Path) -> MappedModel:
    pairs = read_verified_pairs(folder / "database.db", MIN_PAIR_MATCHES)
    ids = {pair.first for pair in pairs} | {pair.second for pair in pairs}
    keypoints = read_keypoints(folder / "database.db", ids)
    return MappedModel.of_models(
        "global", [model], ModelEvidence(pairs, keypoints, PosePriors()), SETTINGS, Monitor()
    )


def judge_model(model: pycolmap.Reconstruction, folder: Path) -> tuple[Decision, Evidence]:
    mapped = examined(model, folder)
    assert mapped.judged.evidence is not None
    return decide([mapped.judged], SETTINGS), mapped.judged.evidence


def test_a_healthy_model_passes(kermit_sfm: SfmResult):
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    decision, found = judge_model(model, kermit_sfm.model_dir.parent)
    assert decision.chosen == 0
    assert found.match_support > 0.98


def test_a_single_image_that_all_its_pairs_contradict_is_left_out(kermit_sfm: SfmResult):
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    last = max(model.images.values(), key=lambda image: image.name)
    quarter = pycolmap.Rigid3d(
        pycolmap.Rotation3d(np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])), np.zeros(3)
    )
    last.frame.set_cam_from_world(last.camera_id, quarter * last.cam_from_world())
    mapped = examined(model, kermit_sfm.model_dir.parent)
    assert mapped.left_out == (last.name,)
    assert decide([mapped.judged], SETTINGS).chosen == 0
    assert mapped.judged.evidence is not None
    assert mapped.judged.evidence.match_support > 0.98
    registered = {image.name for image in model.images.values() if image.has_pose}
    assert len(registered) == 10
    assert last.name not in registered
    assert all(last.image_id not in {e.image_id for e in p.track.elements} for p in model.points3D.values())


def folded(model: pycolmap.Reconstruction) -> None:
    """Half of the images land where the other half is, as a repeated pattern does."""
    images = sorted(model.images.values(), key=lambda image: image.name)
    half = len(images) // 2
    for image, twin in zip(images[half:], images[:half], strict=False):
        image.frame.set_cam_from_world(image.camera_id, twin.cam_from_world())


def shuffled(model: pycolmap.Reconstruction) -> None:
    images = sorted(model.images.values(), key=lambda image: image.name)
    poses = [image.cam_from_world() for image in images]
    for image, pose in zip(images, poses[3:] + poses[:3], strict=True):
        image.frame.set_cam_from_world(image.camera_id, pose)


def torn(model: pycolmap.Reconstruction) -> None:
    """One half is turned by 20° about the scene against the other: each is right in itself."""
    images = sorted(model.images.values(), key=lambda image: image.name)
    middle = np.median([point.xyz for point in model.points3D.values()], axis=0)
    angle = np.radians(20.0)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    shift = pycolmap.Rigid3d(pycolmap.Rotation3d(turn), middle - turn @ middle)
    for image in images[len(images) // 2 :]:
        image.frame.set_cam_from_world(image.camera_id, image.cam_from_world() * shift)


@pytest.mark.parametrize("spoil", [folded, shuffled, torn])
def test_a_model_with_spoilt_poses_is_rejected_although_all_images_are_registered(
    spoil: object, kermit_sfm: SfmResult
):
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    assert callable(spoil)
    spoil(model)
    assert model.num_reg_images() == 11
    decision, found = judge_model(model, kermit_sfm.model_dir.parent)
    assert decision.chosen is None, found


@pytest.mark.parametrize(("images", "left_out"), [(1, 1), (5, 0)])
def test_images_that_hardly_any_point_holds_are_left_out_if_they_are_few(
    kermit_sfm: SfmResult, images: int, left_out: int
):
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    bare = sorted(model.images.values(), key=lambda image: image.name)[-images:]
    for image in bare:
        for index in [k for k, point in enumerate(image.points2D) if point.has_point3D()][14:]:
            if image.points2D[index].has_point3D():  # the track may be gone with its second observation
                model.delete_observation(image.image_id, index)
    mapped = examined(model, kermit_sfm.model_dir.parent)
    assert mapped.with_few_points == tuple(image.name for image in bare[:left_out])
    assert len(mapped.judged.centres) == 11 - left_out
    assert mapped.left_out == ()
