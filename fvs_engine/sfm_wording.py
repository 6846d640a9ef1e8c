"""The sentences and hints of findings of structure from motion."""

from collections.abc import Mapping

from fvs_schema.findings import FindingCode

_BETWEEN = "Photograph what lies between them and the others."
_LOOK = "Look at the result before use."
_CONNECT = "Photograph what connects them with the others, or leave out what shows another place."

SFM_WORDING: Mapping[FindingCode, tuple[str, str]] = {
    FindingCode.NO_FEATURES: (
        "No features could be found in {images}.",
        "A photograph has none when it is blurred, too dark, or shows nothing with structure.",
    ),
    FindingCode.FEW_FEATURES: (
        "Almost no texture in {images}.",
        "Photograph something with structure, in focus and in light.",
    ),
    FindingCode.UNCALIBRATED: (
        "The view graph could not be calibrated; focal lengths start from a guess.",
        "Give the camera's calibration, or photographs with their focal length in EXIF.",
    ),
    FindingCode.NO_PAIRS: (
        "No pair of images matches.",
        "Take photographs that overlap by two thirds, of something with texture.",
    ),
    FindingCode.MATCH_SUPPORT: ("{support:.1%} of the verified matches fit the cameras.", _LOOK),
    FindingCode.ROTATION_SUPPORT: (
        "Only {support:.1%} of the independent relative rotations agree with the cameras.",
        _LOOK,
    ),
    FindingCode.DIRECTION_SUPPORT: (
        "Only {support:.1%} of the independent directions between cameras agree with them.",
        _LOOK,
    ),
    FindingCode.CONTRADICTED_POSES: (
        "Matches contradict the poses of {count} of {of:.0f} images: {images}.",
        _LOOK,
    ),
    FindingCode.WEAK_POSES: ("The poses of {images} are weakly supported.", _BETWEEN),
    FindingCode.WRONG_DISTANCE: (
        "Features seen in three images contradict the distance of {images} to the other images.",
        _LOOK,
    ),
    FindingCode.UNKNOWN_DISTANCE: (
        "Hardly any feature of {images} is seen in two other images, so nothing confirms the distance from "
        "the rest of the model.",
        "Take photographs in between.",
    ),
    FindingCode.LOOSELY_LINKED: (
        "Only a few matches connect {images} with the rest of the model. Look-alike places cause this, too.",
        "Photographs taken in between would settle it.",
    ),
    FindingCode.CONFLICTING_VIEWS: (
        "{pairs} should overlap according to their poses, but large parts of them differ: two look-alike "
        "places may have been merged, or something blocked the view.",
        "Give positions, or take photographs along the way between them.",
    ),
    FindingCode.UNLIKELY_FOCAL_LENGTH: (
        "The estimated focal length, {focal_px} px, is implausible or contradicts EXIF. A flat scene seen "
        "head-on does not determine it.",
        "Photograph it from the side, too, or give the camera's calibration.",
    ),
    FindingCode.FAR_FROM_PRIORS: (
        "{count} of {of:.0f} images are far from their position priors: {images}. Either their poses or "
        "these positions are wrong.",
        "Check these positions, and look at the result before use.",
    ),
    FindingCode.CENTRES_OFF_PRIORS: (
        "The camera centres are {share:.0%} of the track off their position priors.",
        "Check the units, axes and altitude datum of the positions.",
    ),
    FindingCode.UNCONFIRMED: (
        "Neither another mapper nor GPS confirms the model.",
        "Give positions, as GPS in EXIF or with the upload.",
    ),
    FindingCode.CONFIRMED_BY_POSITIONS: (
        "Matches contradict the poses of {count} of {of:.0f} images: {images}. Only their positions confirm "
        "them.",
        _LOOK,
    ),
    FindingCode.HARDLY_CONFIRMED: ("Only agreement with {source} confirms the cameras.", _LOOK),
    FindingCode.RIVAL_MODEL: (
        "The {mapper} mapper found another model that the matches support as well; at least one of them is "
        "wrong.",
        _LOOK,
    ),
    FindingCode.POSITIONS_IGNORED: (
        "The position priors contradict the images and are not used: the baselines between matched images do "
        "not fit them.",
        "Check their units and axes, and whether they belong to these images.",
    ),
    FindingCode.ORIENTATIONS_IGNORED: (
        "The orientation priors contradict the position priors and are not used.",
        "Check from where the angles count, and which way round.",
    ),
    FindingCode.FROZEN_POSITIONS: (
        "{frozen:.0f} of {of:.0f} images have the same position as {others:.0f} others or more: the receiver "
        "froze. These positions are not used.",
        "Wait for a fix of the receiver before the flight.",
    ),
    FindingCode.POSE_UNSUPPORTED: (
        "{images} is not registered: {supported:.0f} of its {matches:.0f} verified matches fit its estimated "
        "pose.",
        "Photographs from between it and the others would help.",
    ),
    FindingCode.POSE_AT_WRONG_DISTANCE: (
        "{images} is not registered: features seen in three images contradict its distance to the others.",
        "Photographs from between it and the others would help.",
    ),
    FindingCode.POSE_FAR_FROM_PRIOR: (
        "{images} is not registered: its estimated position is {distance:.3g} off its position prior; one of "
        "the two is wrong.",
        "Check its position. Photographs from between it and the others would help.",
    ),
    FindingCode.POSE_UNCERTAIN: (
        "{images} is not registered: its matches leave its position uncertain by {share:.0%} of the spread "
        "of all positions.",
        "Photographs from between it and the others would help.",
    ),
    FindingCode.POSE_UNDETERMINED: (
        "{images} is not registered: its matches do not determine its position.",
        "Photographs from between it and the others would help.",
    ),
    FindingCode.LOOK_ALIKE_PLACE: (
        "{images} is not registered: its position prior contradicts all verified pairs that join it with the "
        "model, so that it shows a look-alike place, or the position is wrong.",
        "Check its position. Photographs from between it and the others would help.",
    ),
    FindingCode.UNMATCHED: ("Not registered, as no other image matches: {images}.", _BETWEEN),
    FindingCode.FEW_POINTS: (
        "Not registered, as too few of the matches are of points in the model: {images}.",
        _BETWEEN,
    ),
    FindingCode.UNREGISTERED: (
        "{count} of {of:.0f} images could not be registered: {images}.",
        _CONNECT,
    ),
    FindingCode.SEPARATE_MODEL: (
        "{count} of {of:.0f} images form a model of their own: {images}. No matches connect it with "
        "this one.",
        "Photograph what lies between the two, or give each a scene.",
    ),
    FindingCode.POSES_LOST: (
        "Global bundle adjustment left {images} without a pose.",
        _BETWEEN,
    ),
    FindingCode.LEFT_OUT: (
        "Left out {count} of {of:.0f} images: {images}. Matches or priors contradict their poses.",
        _CONNECT,
    ),
    FindingCode.QUARANTINED: (
        "{images} is quarantined: it crashes the stage {stage} whenever that gets it ({how}).",
        "Replace it by another photograph.",
    ),
    FindingCode.NO_IMAGE_OF_CAMERA: (
        "{count} of the given cameras have no image here: {images}.",
        "Give the folder of photographs that the cameras belong to.",
    ),
    FindingCode.SUPPORT_FELL: (
        "All images are mapped again, as match support fell from {before:.1%} to {now:.1%}.",
        _LOOK,
    ),
    FindingCode.MANY_UNREGISTERED: (
        "All images are mapped again, as {unregistered:.0f} that match registered ones are unregistered.",
        _BETWEEN,
    ),
    FindingCode.REMAPPED: (
        "A re-map by {mapper} mapping replaced the current model.",
        "Poses of registered images may have changed.",
    ),
    FindingCode.NO_BETTER_MODEL: (
        "The re-map found no better model.",
        _BETWEEN,
    ),
    FindingCode.NEW_MODEL_REJECTED: (
        "A model of all images together was rejected, so the current one stays.",
        _BETWEEN,
    ),
    FindingCode.NEW_MODEL_DOUBTFUL: (
        "A model of all images together is doubtful and no better, so the current one stays.",
        _BETWEEN,
    ),
    FindingCode.NEW_MODEL_UNALIGNED: (
        "A model of all images shares too few cameras with the current one to be aligned with it.",
        _BETWEEN,
    ),
    FindingCode.FEW_STARTS: (
        "The {views:.0f} registered views share only {points:.0f} points: Gaussians also start at guessed "
        "depths.",
        _BETWEEN,
    ),
}
