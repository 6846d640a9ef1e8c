import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.pipeline.candidates import candidates_at, candidates_between, read_candidates
from fvs_engine.scene.scene_model import usual_camera
from fvs_engine.views import PinholeView

PLACE = {"position": [1, 2, 3], "orientation_wxyz": [0.5, 0.5, -0.5, 0.5]}
POSE = {"id": "a", "pose": PLACE}


def _posed(**pose: Any) -> list[dict[str, Any]]:
    return [{"id": "a", "pose": {**PLACE, **pose}}]


@pytest.fixture
def camera() -> PinholeCamera:
    return PinholeCamera(64, 48, 60.0, 61.0, 32.0, 24.0)


@pytest.fixture
def views(camera: PinholeCamera) -> tuple[PinholeView, ...]:
    """Eight views on a circle of radius 3 about the origin, not quite in one plane."""
    placed = []
    for index in range(8):
        angle = index * np.pi / 4
        centre = [3 * np.cos(angle), 3 * np.sin(angle), 0.2 * (index % 3)]
        placed.append(
            PinholeView(f"{index:02d}.png", camera, look_at(centre, [0, 0, 0], [0, 0, 1]).inverse())
        )
    return tuple(placed)


def _read(tmp_path: Path, document: Any, views: tuple[PinholeView, ...]) -> tuple[PinholeView, ...]:
    path = tmp_path / "candidates.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return read_candidates(path, views, {"00.tif": "00.png"})


def test_a_pose_is_model_from_camera(
    tmp_path: Path, views: tuple[PinholeView, ...], camera: PinholeCamera
) -> None:
    (candidate,) = _read(tmp_path, [POSE], views)
    assert candidate.name == "a"
    assert candidate.camera == camera
    model_from_camera = candidate.camera_from_model.inverse()
    np.testing.assert_allclose(model_from_camera.translation, [1, 2, 3], atol=1e-12)
    # wxyz (½, ½, −½, ½): the axes of the camera in the model, by hand
    expected = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    np.testing.assert_allclose(model_from_camera.rotation, expected, atol=1e-12)


def test_a_camera_of_its_own(tmp_path: Path, views: tuple[PinholeView, ...]) -> None:
    own = {"width": 32, "height": 16, "fx": 20, "fy": 21, "cx": 16, "cy": 8.5}
    (candidate,) = _read(tmp_path, [{**POSE, "camera": own}], views)
    assert candidate.camera == PinholeCamera(32, 16, 20.0, 21.0, 16.0, 8.5)


def test_known_views_by_either_name(tmp_path: Path, views: tuple[PinholeView, ...]) -> None:
    document = [{"id": "x", "view": "03.png"}, {"id": "y", "view": "00.tif"}]
    first, second = _read(tmp_path, document, views)
    np.testing.assert_array_equal(first.camera_from_model.rotation, views[3].camera_from_model.rotation)
    np.testing.assert_array_equal(
        second.camera_from_model.translation, views[0].camera_from_model.translation
    )


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("", "not JSON"),
        ("{}", "neither a list of candidates nor"),
        ('"x"', "neither a list of candidates nor"),
        ("[]", "holds no pose"),
        ([1], "candidate 0, the entry: "),
        ([POSE, {}], "candidate 1, id: it is missing"),
        ([{**POSE, "yaw_deg": 3}], "candidate 0, yaw_deg: there is no such field"),
        ([{"id": "a", **PLACE}], "candidate 0, pose: it is missing"),
        (_posed(frame="world"), "candidate 0, pose.frame: it must be 'model'"),
        (_posed(position=[1, 2]), "candidate 0, pose.position"),
        (_posed(position=["1", 2, 3]), "candidate 0, pose.position.0: it must be a number"),
        ([{**POSE, "id": ""}], "candidate 0, id: it must not be empty"),
        (_posed(orientation_wxyz=[1, 1, 0, 0]), "pose.orientation_wxyz: its length is 1.414, not 1"),
        (_posed(orientation_wxyz=[0, 0, 0, 0]), "its length is 0, not 1"),
        (json.dumps(_posed(position=[math.nan, 0, 0])), "position.0: it must be a finite number"),
        (json.dumps(_posed(position=["far", 0, 0])).replace('"far"', "1e999"), "position.0: .* finite"),
        (_posed(position=[0, -1e300, 0]), "candidate 0, pose.position.1: it must be at least -1000000000"),
        ([POSE, POSE], "two candidates called 'a'"),
        ([{"id": "x", "view": "99.png"}], "no view '99.png'"),
        ([{"id": "x", "view": "03.png", "pose": PLACE}], "pose: there is no such field"),
        ([{**POSE, "camera": {"width": 0, "height": 1, "fx": 1, "fy": 1, "cx": 0, "cy": 0}}], "camera.width"),
    ],
)
def test_mistakes_are_named(
    tmp_path: Path, views: tuple[PinholeView, ...], document: Any, message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message) as caught:
        _read(tmp_path, document, views)
    assert "candidates.json" in caught.value.message


def test_a_missing_file_is_named(tmp_path: Path, views: tuple[PinholeView, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"nope\.json cannot be read"):
        read_candidates(tmp_path / "nope.json", views, {})


def test_a_quaternion_that_is_nearly_unit_gives_a_rotation(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    (candidate,) = _read(tmp_path, _posed(orientation_wxyz=[0.9999, 0, 0, 0]), views)
    np.testing.assert_allclose(candidate.camera_from_model.rotation, np.eye(3), atol=1e-12)


def _transforms(views: tuple[PinholeView, ...], prefix: str = "images/") -> dict[str, Any]:
    """The views in a frame that is the model's turned a quarter about z, half as large, and shifted."""
    turn = RigidTransform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.zeros(3))
    frames = []
    for view in views:
        model_from_camera = view.camera_from_model.inverse()
        file_from_camera = np.eye(4)
        file_from_camera[:3, :3] = turn.rotation @ model_from_camera.rotation @ np.diag([1, -1, -1])
        file_from_camera[:3, 3] = turn.apply(model_from_camera.translation) / 2 + [5, 6, 7]
        frames.append({"file_path": f"{prefix}{view.name}", "transform_matrix": file_from_camera.tolist()})
    return {"w": 64, "h": 48, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "frames": frames}


def _renamed(views: tuple[PinholeView, ...], names: list[str]) -> tuple[PinholeView, ...]:
    return tuple(replace(view, name=name) for view, name in zip(views, names, strict=True))


def test_frames_of_a_transforms_json_that_the_model_lacks_become_candidates(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    known = views[:3] + views[5:]
    candidates = _read(tmp_path, _transforms(views), known)
    assert [Path(candidate.name).name for candidate in candidates] == ["03.png", "04.png"]
    for candidate, view in zip(candidates, views[3:5], strict=True):
        expected = view.camera_from_model.inverse()
        got = candidate.camera_from_model.inverse()
        np.testing.assert_allclose(got.translation, expected.translation, atol=1e-9)
        np.testing.assert_allclose(got.rotation, expected.rotation, atol=1e-9)


def test_views_of_a_transforms_json_are_told_apart_by_their_folders(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    names = [f"{side}/{index}.png" for index in range(4) for side in ("left", "right")]
    renamed = _renamed(views, names)
    (candidate,) = _read(tmp_path, _transforms(renamed, prefix=""), renamed[:-1])
    assert candidate.name == "right/3.png"
    centre = candidate.camera_from_model.inverse().translation
    np.testing.assert_allclose(centre, views[-1].camera_from_model.inverse().translation, atol=1e-9)


def test_a_transforms_json_knows_views_by_their_source_names(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    named_at_the_source = _renamed(views, ["00.tif", *(view.name for view in views[1:])])
    (candidate,) = _read(tmp_path, _transforms(named_at_the_source), views[:-1])
    assert candidate.name == "images/07.png"


def test_a_transforms_json_that_contradicts_the_model_is_refused(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    shuffled = _renamed(views, [views[index].name for index in (0, 4, 1, 5, 2, 6, 3, 7)])
    with pytest.raises(InvalidInputError, match="have other positions"):
        _read(tmp_path, _transforms(shuffled), views)


def test_a_transforms_json_with_other_axes_is_refused(tmp_path: Path, views: tuple[PinholeView, ...]) -> None:
    document = _transforms(views)
    for frame in document["frames"]:  # as whoever forgets that OpenGL's cameras look backwards writes it
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])).tolist()
    with pytest.raises(InvalidInputError, match="differ by 180°") as caught:
        _read(tmp_path, document, views[:-1])
    assert "OpenGL axes" in caught.value.hint


def test_a_transforms_json_of_nothing_but_the_model_s_views_has_no_candidate(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    with pytest.raises(InvalidInputError, match=r"All 8 frames of .*candidates\.json are photographs"):
        _read(tmp_path, _transforms(views), views)


def test_views_on_a_line_do_not_place_a_transforms_json(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    on_a_line = tuple(
        replace(view, camera_from_model=look_at([index, 0, 0], [index, 5, 0], [0, 0, 1]).inverse())
        for index, view in enumerate(views)
    )
    with pytest.raises(InvalidInputError, match="lie on a line"):
        _read(tmp_path, _transforms(on_a_line), on_a_line[:-1])


def test_a_transforms_json_of_another_scene_is_refused(
    tmp_path: Path, views: tuple[PinholeView, ...]
) -> None:
    frames = [{"file_path": f"other{i}.png", "transform_matrix": np.eye(4).tolist()} for i in range(4)]
    document = {"w": 64, "h": 48, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "frames": frames}
    with pytest.raises(InvalidInputError, match="shares 0 of its views"):
        _read(tmp_path, document, views)


def test_without_a_file_candidates_stand_between_neighbours(views: tuple[PinholeView, ...]) -> None:
    candidates = candidates_between(views)
    assert {candidate.name for candidate in candidates} == {f"{i:02d}–{i + 1:02d}" for i in range(7)} | {
        "00–07"
    }
    first = next(candidate for candidate in candidates if candidate.name == "00–01")
    centres = [view.camera_from_model.inverse().translation for view in views[:2]]
    np.testing.assert_allclose(first.camera_from_model.inverse().translation, np.mean(centres, axis=0))


def test_candidates_between_views_of_equal_stems_have_names_of_their_own(
    views: tuple[PinholeView, ...],
) -> None:
    renamed = _renamed(views, [f"{side}/{index}.png" for index in range(4) for side in ("left", "right")])
    names = [candidate.name for candidate in candidates_between(renamed)]
    assert len(set(names)) == len(names)
    assert "left/0.png–right/0.png" in names


def test_candidates_at_views_share_one_camera(views: tuple[PinholeView, ...], camera: PinholeCamera) -> None:
    other = PinholeCamera(48, 64, 60.0, 61.0, 24.0, 32.0)
    mixed = (*views[:2], PinholeView("z.png", other, views[2].camera_from_model))
    assert usual_camera(mixed) == camera
    assert {candidate.camera for candidate in candidates_at(mixed, usual_camera(mixed))} == {camera}
