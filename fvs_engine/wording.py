"""The sentence and the hint of every finding: the only place where findings become prose."""

from collections.abc import Mapping

from fvs_engine.images.names import listed
from fvs_engine.sfm_wording import SFM_WORDING
from fvs_schema.candidates import CandidateStatus
from fvs_schema.findings import Finding, FindingCode, Notice, Severity

NEARER = "Give candidates nearer to the images: at most 15° from one to the next, as seen from the scene."
ELSEWHERE = (
    "Give candidates above the ground and farther from matter, and as near to the images as these are to "
    "each other."
)

WORDING: Mapping[FindingCode, tuple[str, str]] = {
    **SFM_WORDING,
    FindingCode.VIEWS_WITHOUT_PHOTOGRAPH: (
        "{count} of the {of:.0f} views in {source} have no photograph: {images}.",
        "Give the folder of photographs that these poses belong to.",
    ),
    FindingCode.PHOTOGRAPHS_WITHOUT_POSE: (
        "{count} photographs have no pose and are not used: {images}.",
        "Give poses of all photographs, or leave these out.",
    ),
    FindingCode.UNUSABLE_PHOTOGRAPH: ("Left out {images}: {why}", "{remedy}"),
    FindingCode.WITHOUT_MASK: (
        "{count} of the {of:.0f} photographs have no mask, and all of them counts: {images}.",
        "Give each photograph a mask that shows something to leave out.",
    ),
    FindingCode.NAMES_RESPELLED: (
        "{count} photographs have another name in the file of the cameras, such as {image}: {name}.",
        "Check that these are the same photographs.",
    ),
    FindingCode.PIXELS_AS_STORED: (
        "{count} photographs are not turned as their EXIF says, because their given cameras belong to the "
        "stored pixels: {images}.",
        "Give cameras of the upright images for upright renders.",
    ),
    FindingCode.FAR_COORDINATES: (
        "The coordinates of the cameras are too large for the 32-bit numbers of splats: files in the folder "
        "have their origin at {x:.12g}, {y:.12g}, {z:.12g}.",
        "Add it to positions in PLY, SPZ and COLMAP files; rankings and plans have the coordinates given.",
    ),
    FindingCode.VIDEO_DAMAGED: (
        "{video} is damaged or cut short: its last frame that can be decoded ends at {read_s:.1f} s.",
        "Go on with these frames, or copy the video from the camera again.",
    ),
    FindingCode.FRAMES_BLURRED: (
        "{count:,} of {of:,.0f} frames are blurred: {images}.",
        "Delete them, or film more slowly, or in more light.",
    ),
    FindingCode.FRAMES_WITHOUT_POSITION: (
        "{count:,} of {of:,.0f} frames have no position: {images}.",
        "Put the drone's subtitles beside the video, as VIDEO.SRT, or film with GPS.",
    ),
    FindingCode.FRAMES_WITHOUT_ALTITUDE: (
        "{count:,} of {of:,.0f} frames have a position without an altitude above sea level, which is not "
        "used: {images}.",
        "Give their altitudes when you upload them.",
    ),
    FindingCode.FRAMES_ABOVE_ELLIPSOID: (
        "{count:,} of {of:,.0f} frames have an altitude above the ellipsoid, which is taken for one above "
        "sea level: {images}.",
        "All are wrong by the height of the geoid, at most 110 m. Control points place the model right.",
    ),
    FindingCode.FRAMES_SPACED_WIDER: (
        "The scene has room for {room:,.0f} more images, and {video} has more frames with a spacing of "
        "{every_s:g} s: they are taken every {spaced_s:.3g} s.",
        "For closer frames send parts of the video to scenes of their own.",
    ),
    FindingCode.FRAMES_LEFT_OUT: (
        "The scene has no room for more images: frames of {video} after {last} are left out.",
        "Send the rest of the video, cut, to another scene.",
    ),
    FindingCode.VIDEO_UNDECODABLE: (
        "Decoding {video} took more memory or time than a video may: no frame after {last} is used.",
        "Convert it, ffmpeg -i VIDEO -c:v libx264 -an NEW.mp4, and send the rest of it.",
    ),
    FindingCode.ALREADY_TRAINED: (
        "Nothing to do: the model has had {iterations:,.0f} iterations already.",
        "Ask for more iterations to train it further.",
    ),
    FindingCode.NONE_HELD_OUT: (
        "No view is held out: {views:.0f} are too few to spare one. The quality is not measured.",
        "Add photographs.",
    ),
    FindingCode.LITTLE_MEMORY: (
        "Training may need {need_gb:.1f} GB of memory, and there are {machine_gb:.1f} GB.",
        "A smaller --long-side or --quality coarse needs less.",
    ),
    FindingCode.FLOATERS_REMOVED: (
        "Left out {floaters:,.0f} of {of:,.0f} Gaussians: they are in the air near a camera, where one "
        "photograph alone shows them.",
        "More photographs, from the sides, show what is really there.",
    ),
    FindingCode.RUN_FAILED: (
        "{method}, seed {seed:.0f}, failed: {error}",
        "The same command tries it again.",
    ),
    FindingCode.STARTED_AGAIN_AFTER_DAMAGE: (
        "A file of the scene was damaged, so the scene was reconstructed from scratch.",
        "Check the disk of the worker.",
    ),
    FindingCode.STARTED_AGAIN_WITH_SETTINGS: (
        "The settings of the service have changed, so the scene was reconstructed from scratch.",
        "Poses have a new model frame.",
    ),
    FindingCode.UPDATE_UNCHANGED: (
        "The update changed nothing: its snapshot is the earlier {snapshot}.",
        "Add images to change the model.",
    ),
    FindingCode.ILL_CONDITIONED: (
        "The photographs lie on a line, or hardly farther apart than their positions are accurate, which "
        "leaves the rotation of the world frame open: poses in it, also geodetic ones, may be off by tens of "
        "degrees.",
        "Fly a second line beside the first, or send yaw, pitch and roll of the camera with every image; or "
        "give poses in the model frame.",
    ),
    FindingCode.POSITIONS_UNUSED: (
        "The positions of the photographs contradict the model, or are too few: the world frame is the "
        "model's, and lengths have no unit.",
        "Check the units, axes and altitude datum of the positions, and whether they belong to these "
        "photographs; or give poses in the model frame.",
    ),
    FindingCode.HEIGHTS_NOT_ELLIPSOIDAL: (
        "Heights are above {surface}. A globe takes them for heights above the ellipsoid, so the scene "
        "stands there too high or too low.",
        "Those above sea level need the geoid: its height above the ellipsoid there, or a grid.",
    ),
    FindingCode.COARSE_POSITIONS: (
        "SPZ and 3D Tiles round all positions to {step_m:.3f} m: they have 24 bits, and a Gaussian lies "
        "{farthest_m:,.0f} m away.",
        "PLY and glTF keep millimetres.",
    ),
    FindingCode.FEW_REGISTRABLE: (
        "Likely to be registered are only {registrable:,.0f} of the {of:,.0f} candidates: they see little of "
        "what the images show, or see it from too far aside.",
        NEARER,
    ),
    FindingCode.NONE_FEASIBLE: ("None of the {of:,.0f} candidates is feasible: {against}.", ELSEWHERE),
    FindingCode.FEWER_CANDIDATES: (
        "The volume has room for {made:,.0f} of the {wanted:,.0f} candidates.",
        "Give a larger volume, a smaller count, or a shorter safety distance.",
    ),
    FindingCode.CANDIDATES_DRAWN: (
        "The plan considers {considered:,.0f} of the {of:,.0f} candidates, drawn evenly: with all of them it "
        "would take too long.",
        "Give fewer candidates, or fewer views.",
    ),
    FindingCode.VEHICLE_BLOCKED: (
        "Vehicle {vehicle:.0f} of {of:.0f} gets no tour: its start is {where}.",
        "Give it another start, or {remedy}.",
    ),
    FindingCode.VEHICLE_WITHOUT_WAY: (
        "Vehicle {vehicle:.0f} of {of:.0f} gets no tour: no way leads from its start to a candidate.",
        "Something is in the way: give it another start, or candidates on its side.",
    ),
    FindingCode.VEHICLE_OUT_OF_RANGE: (
        "Vehicle {vehicle:.0f} of {of:.0f} gets no tour: its distance of {distance:.4g} does not reach any "
        "candidate; the nearest is {nearest:.4g} away.",
        "Give at least {least:.4g} for the way, or nearer candidates.",
    ),
    FindingCode.TOO_CLOSE: (
        "Not planned, as they are inside matter, too close to it or in a no-fly zone: {left_out:,.0f} of the "
        "{of:,.0f} candidates.",
        ELSEWHERE,
    ),
    FindingCode.UNDER_GROUND: (
        "Not planned, as they are under the ground: {chosen:,.0f} of the {of:,.0f} candidates: {candidates}.",
        "Give candidates above it, and check that terrain and scene measure heights from the same datum.",
    ),
    FindingCode.GROUND_UNKNOWN: (
        "The terrain has no height at {chosen:,.0f} of the {of:,.0f} candidates, so it is not known whether "
        "they are under the ground: {candidates}.",
        "Give a terrain that covers them, without holes; `gdal_fillnodata` closes those of a file.",
    ),
    FindingCode.UNREACHABLE: (
        "{missed:,.0f} of the {of:,.0f} candidates cannot be reached: no-fly zones or the model are in the "
        "way.",
        "Give a start on their side, smaller zones or a shorter safety distance.",
    ),
    FindingCode.SAME_POSE: (
        "A plan takes one photograph of each pose; {copies:,.0f} of the {of:,.0f} candidates repeat that of "
        "another.",
        "Give candidates whose positions or directions differ.",
    ),
    FindingCode.NOTHING_IN_VIEW: (
        "None of the planned views shows anything of the model.",
        "Give candidates that look at the model, and check that they are in the frame of the scene.",
    ),
    FindingCode.CONTROL_POINT_OFF: (
        "Control point {point} is {distance_m:.3g} m from where the others put it, and is not used.",
        "Check its coordinates and its name.",
    ),
    FindingCode.CONTROL_POINTS_SWAPPED: (
        "The points {first} and {second} are swapped: each is where the other should be. They are not used.",
        "Swap their names or their coordinates.",
    ),
    FindingCode.CONTROL_POINT_SEEN_ONCE: (
        "Point {point} is not measured: fewer than two registered images have a mark of it.",
        "Mark it in two photographs or more that look at it from different sides.",
    ),
    FindingCode.CONTROL_POINT_WITHOUT_PARALLAX: (
        "Point {point} is not measured: its marks see it from the same direction.",
        "Mark it in photographs that look at it from different sides.",
    ),
    FindingCode.CONTROL_MARKS_DISAGREE: (
        "Point {point} is not measured: its marks contradict one another.",
        "Check them. They are in px of the file as it is stored, from its top left corner.",
    ),
    FindingCode.CONTROL_MARK_OFF: (
        "The marks of point {point} in {images} contradict the others, and are not used.",
        "Check them. They are in px of the file as it is stored, from its top left corner.",
    ),
    FindingCode.MARKED_IMAGES_UNKNOWN: (
        "Marks in images that are not there are not used: {images}.",
        "Check their names.",
    ),
    FindingCode.CONTROL_POINTS_UNUSED: ("The control points are not used. {why}", "{remedy}"),
}
"""Code → the sentence and the hint, as format strings.

Fields are the finding's numbers and texts, ``images`` and ``candidates`` (the first few), ``count`` and
``chosen``, how many these are, ``pairs``, and ``against``, how many candidates are not feasible for which
reason.
"""

AGAINST = {
    CandidateStatus.IN_MATTER: "inside matter",
    CandidateStatus.TOO_CLOSE: "too close to matter",
    CandidateStatus.NO_FLY: "in a no-fly zone",
    CandidateStatus.UNDER_GROUND: "under the ground",
    CandidateStatus.OUT_OF_MODEL: "out of the model",
    CandidateStatus.UNREGISTRABLE: "unlikely to be registered",
}
"""Statuses of candidates that are not feasible → what is against them."""

BLOCKED = {
    CandidateStatus.NO_FLY: ("in a no-fly zone", "smaller zones"),
    CandidateStatus.TOO_CLOSE: (
        "inside a solid part of the model, or within the safety distance of one",
        "a shorter safety distance",
    ),
}
"""What blocks all ways from a vehicle's start → where the start is, and the remedy beside another start."""


def sentence(finding: Finding) -> str:
    """What was found, for people."""
    start = "DOUBTFUL CAMERAS: " if finding.severity is Severity.DOUBT else ""
    if (first := finding.numbers.get("first_images")) is not None:
        start = f"The first {first:.0f} images: {start}"
    return start + WORDING[finding.code][0].format(**_fields(finding))


def hint(finding: Finding) -> str:
    """What to do about it."""
    return WORDING[finding.code][1].format(**_fields(finding))


def text(finding: Finding) -> str:
    """Both, as one line."""
    return f"{sentence(finding)} {hint(finding)}"


def notice(finding: Finding) -> Notice:
    """The finding with its sentence and hint."""
    return Notice(**finding.model_dump(), message=sentence(finding), hint=hint(finding))


def _fields(finding: Finding) -> dict[str, object]:
    images = finding.images
    against = [
        f"{finding.numbers[status]:,.0f} {reason}"
        for status, reason in AGAINST.items()
        if status in finding.numbers
    ]
    pairs = [f"{first} and {second}" for first, second in zip(images[::2], images[1::2], strict=False)]
    status = finding.texts.get("status")
    where, remedy = BLOCKED[CandidateStatus(status)] if status else ("", "")
    return {
        "where": where,
        "remedy": remedy,
        "images": listed(images),
        "pairs": listed(pairs),
        "count": len(images),
        "candidates": listed(finding.candidates),
        "chosen": len(finding.candidates),
        "against": ", ".join(against),
        **finding.numbers,
        **finding.texts,
    }
