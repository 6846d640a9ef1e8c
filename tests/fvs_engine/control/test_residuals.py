"""Marks of known points in known cameras, through a known similarity: what is found is known."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.control.residuals import ControlResult, align_by_control
from fvs_engine.control.triangulation import Sight
from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import DistortedCamera, SimilarityTransform, look_at, matrix_from_quaternion
from fvs_engine.geometry.crs import NamedCrs
from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.views import View
from fvs_schema.control_points import ControlPoint, ControlPoints, PointStatus
from fvs_schema.findings import FindingCode
from fvs_schema.scenes import AlignmentSource, AltitudeDatum, Origin

LENS = DistortedCamera("OPENCV", 800, 600, (640.0, 642.0, 404.0, 297.0, 0.08, -0.02, 0.001, -0.002))
MODEL_FROM_WORLD = SimilarityTransform(
    0.02, Rotation.from_euler("zyx", [70, -20, 160], degrees=True).as_matrix(), np.array([1.0, -2.0, 0.5])
)
HOME = GeodeticPosition(50.82, -0.14, 80.0)
PLACES = {
    "A": (-30.0, -30.0, 0.0),
    "B": (30.0, -28.0, 1.0),
    "C": (28.0, 31.0, 4.0),
    "D": (-29.0, 29.0, 9.0),
    "E": (1.0, 3.0, 2.0),
    "F": (14.0, -9.0, 5.0),
    "X": (-12.0, 11.0, 1.0),
}
Marks = dict[str, list[Sight]]


class Site:
    """Seven cameras about seven points: what is given of them, to be spoilt by a test."""

    def __init__(self, home: GeodeticPosition = HOME, noise_px: float = 0.0, crs: str = "EPSG:4326") -> None:
        draw = np.random.default_rng(0)
        angles = np.linspace(0.0, 5.0, 7)
        views = [
            View(
                f"{number}.jpg",
                LENS,
                MODEL_FROM_WORLD.move_camera(
                    look_at(
                        np.array([70 * np.cos(angle), 70 * np.sin(angle), 50.0]),
                        np.zeros(3),
                        np.array([0.0, 0.0, 1.0]),
                    )
                ).inverse(),
            )
            for number, angle in enumerate(angles)
        ]
        self.sights: Marks = {
            name: [
                Sight(view, pixel + draw.normal(0.0, noise_px, 2))
                for view in views
                if np.isfinite(
                    pixel := view.camera.project(
                        view.camera_from_model.apply(MODEL_FROM_WORLD.apply(np.array(place)))
                    )
                ).all()
            ]
            for name, place in PLACES.items()
        }
        assert min(map(len, self.sights.values())) > 4
        self.points = {
            name: ControlPoint(
                name=name,
                x=(position := geodetic_from_enu(np.array(place), home)).longitude_deg,
                y=position.latitude_deg,
                z=position.altitude_m,
                check=name == "X",
                marks=(),
            )
            for name, place in PLACES.items()
        }
        self.crs, self.home = crs, home

    def swap(self, one: str, other: str) -> None:
        """Give two points each other's coordinates."""
        first, second = self.points[one], self.points[other]
        self.points[one] = first.model_copy(update={"x": second.x, "y": second.y, "z": second.z})
        self.points[other] = second.model_copy(update={"x": first.x, "y": first.y, "z": first.z})

    def align(self, origin: Origin | None = None) -> ControlResult:
        """The alignment by what is given."""
        control = ControlPoints(crs=self.crs, points=tuple(self.points.values()))
        return align_by_control(control, self.sights, origin)


def _statuses(result: ControlResult) -> Mapping[str, PointStatus]:
    return {point.name: point.status for point in result.residuals.points}


def _world_from_model(result: ControlResult) -> SimilarityTransform:
    found = result.alignment
    return SimilarityTransform(
        found.scale, matrix_from_quaternion(found.rotation_wxyz), np.array(found.translation)
    )


@pytest.mark.parametrize(
    "home",
    [
        HOME,
        GeodeticPosition(-17.0, 179.9999, 12.0),
        GeodeticPosition(89.9999, 40.0, 3.0),
        GeodeticPosition(-90.0, 0.0, 2_800.0),
    ],
)
def test_the_model_lies_where_the_points_were_surveyed(home: GeodeticPosition) -> None:
    """At the antimeridian and the poles too, within a tenth of a millimetre."""
    origin = Origin(
        latitude_deg=home.latitude_deg, longitude_deg=home.longitude_deg, altitude_m=home.altitude_m
    )
    result = Site(home).align(origin)
    assert _statuses(result) == {name: "check" if name == "X" else "used" for name in PLACES}
    both = _world_from_model(result) @ MODEL_FROM_WORLD
    places = np.array(list(PLACES.values()))
    np.testing.assert_allclose(both.apply(places), places, atol=1e-4)
    assert result.alignment.source is AlignmentSource.CONTROL_POINTS
    assert (result.alignment.inliers, result.alignment.positions) == (6, 6)
    assert result.residuals.control_rms_m < 1e-4
    assert result.residuals.check_rms_m is not None
    assert result.residuals.check_rms_m < 1e-4
    assert result.findings == ()


def test_points_far_from_the_scene_are_refused() -> None:
    """As those of another UTM zone are."""
    site = Site()
    near = Origin(latitude_deg=HOME.latitude_deg, longitude_deg=HOME.longitude_deg + 0.2, altitude_m=0.0)
    assert site.align(near).findings == ()
    far = near.model_copy(update={"longitude_deg": HOME.longitude_deg + 6.0})
    with pytest.raises(InvalidInputError, match=r"4\d\d km") as raised:
        site.align(far)
    assert "zone" in str(raised.value.hint)


def test_the_origin_is_in_the_middle_with_the_datum_of_the_heights() -> None:
    site = Site()
    result = site.align()
    assert result.origin.altitude_datum is AltitudeDatum.SEA_LEVEL
    assert abs(result.origin.latitude_deg - HOME.latitude_deg) < 1e-3
    site.crs = "EPSG:4979"
    assert site.align().origin.altitude_datum is AltitudeDatum.ELLIPSOID


def test_residuals_of_noisy_marks_are_of_the_size_of_a_pixel_on_the_ground() -> None:
    result = Site(noise_px=0.7).align()
    for point in result.residuals.points:
        assert point.distance_m is not None
        assert 0.0 < point.distance_m < 0.2  # a pixel is 13 cm
        assert point.reprojection_px is not None
        assert 0.3 < point.reprojection_px < 1.5
    assert result.findings == ()


def test_swapped_points_are_named_and_not_used() -> None:
    site = Site(noise_px=0.5)
    site.swap("B", "D")
    result = site.align()
    assert _statuses(result) == {
        **dict.fromkeys("ACEF", PointStatus.USED),
        **dict.fromkeys("BD", PointStatus.OUTLIER),
        "X": PointStatus.CHECK,
    }
    (finding,) = result.findings
    assert finding.code is FindingCode.CONTROL_POINTS_SWAPPED
    assert finding.texts == {"first": "B", "second": "D"}


def test_a_check_point_may_be_one_of_the_swapped() -> None:
    site = Site()
    site.swap("B", "X")
    (finding,) = site.align().findings
    assert finding.texts == {"first": "B", "second": "X"}


@pytest.mark.parametrize("left", ["ABCD", "ABCDE"])
def test_too_few_points_to_outvote_swapped_ones_are_refused_and_the_pair_is_named(left: str) -> None:
    """Three of a rectangle's corners nearly fit their mirror image: that must not pass."""
    site = Site(noise_px=0.3)
    site.swap("B", "D")
    site.points = {name: site.points[name] for name in (*left, "X")}
    with pytest.raises(InvalidInputError, match="contradict") as raised:
        site.align()
    assert "B and D may be swapped" in raised.value.hint


def test_a_point_that_was_surveyed_wrongly() -> None:
    site = Site()
    site.points["C"] = site.points["C"].model_copy(update={"z": 74.0})  # 10 m too low
    result = site.align()
    assert _statuses(result)["C"] is PointStatus.OUTLIER
    off = result.residuals.points[2]
    assert off.up_m == pytest.approx(10.0, abs=1e-3)
    (finding,) = result.findings
    assert finding.code is FindingCode.CONTROL_POINT_OFF
    assert finding.numbers["distance_m"] == pytest.approx(10.0, abs=1e-3)


def test_points_that_are_not_measured_say_why() -> None:
    site = Site()
    site.sights["A"] = site.sights["A"][:1]
    site.sights["B"] = [site.sights["B"][0]] * 2
    site.sights["C"] = [
        replace(sight, pixel=sight.pixel + np.array([40.0, -60.0]) * number)
        for number, sight in enumerate(site.sights["C"])
    ]
    with pytest.raises(InvalidInputError) as raised:
        _only(site, "ABCDE").align()
    for reason in ("seen-once: A", "no-parallax: B", "marks-disagree: C"):
        assert reason in raised.value.message
    site = _only(site, "ABCDEF")
    result = site.align()
    assert [finding.code for finding in result.findings] == [
        FindingCode.CONTROL_POINT_SEEN_ONCE,
        FindingCode.CONTROL_POINT_WITHOUT_PARALLAX,
        FindingCode.CONTROL_MARKS_DISAGREE,
    ]
    assert _statuses(result)["A"] is PointStatus.SEEN_ONCE


def _only(site: Site, names: Sequence[str]) -> Site:
    found = Site()
    found.sights, found.points = site.sights, {name: found.points[name] for name in names}
    return found


def test_a_wrong_mark_is_named_and_not_used() -> None:
    site = Site()
    site.sights["E"][2] = replace(site.sights["E"][2], pixel=site.sights["F"][2].pixel)
    result = site.align()
    point = result.residuals.points[4]
    assert point.wrong_marks == (site.sights["E"][2].view.name,)
    assert point.distance_m is not None
    assert point.distance_m < 1e-3
    (finding,) = result.findings
    assert (finding.code, finding.images) == (FindingCode.CONTROL_MARK_OFF, point.wrong_marks)


def test_a_point_without_height_checks_its_horizontal_position() -> None:
    site = Site()
    site.points["E"] = site.points["E"].model_copy(update={"z": None})
    result = site.align()
    point = result.residuals.points[4]
    assert (point.status, point.up_m) == (PointStatus.NO_HEIGHT, None)
    assert point.distance_m is not None
    assert point.distance_m < 1e-3


def test_points_of_another_place_are_refused() -> None:
    site = Site()
    for number, (name, point) in enumerate(site.points.items()):
        site.points[name] = point.model_copy(update={"x": site.points["A"].x + 1e-4 * number})
    with pytest.raises(InvalidInputError, match="contradict") as raised:
        site.align()
    assert "x is east" in raised.value.hint


def test_points_on_a_line_leave_the_rotation_about_it_open() -> None:
    site = _only(Site(noise_px=0.3), "ACE")
    place = np.array(PLACES["A"]) + 0.5 * (np.array(PLACES["C"]) - np.array(PLACES["A"]))
    position = geodetic_from_enu(place, HOME)
    site.points["E"] = site.points["E"].model_copy(
        update={"x": position.longitude_deg, "y": position.latitude_deg, "z": position.altitude_m}
    )
    at = MODEL_FROM_WORLD.apply(place)
    site.sights["E"] = [
        replace(sight, pixel=sight.view.camera.project(sight.view.camera_from_model.apply(at)))
        for sight in site.sights["E"]
    ]
    with pytest.raises(InvalidInputError, match="on a line"):
        site.align()


def test_eastings_are_in_the_named_crs() -> None:
    site = Site(crs="EPSG:32630")
    for name, point in site.points.items():
        assert point.z is not None
        site.points[name] = point.model_copy(
            update={"x": 700_000 + PLACES[name][0], "y": 5_633_000 + PLACES[name][1]}
        )
    result = site.align()
    middle = NamedCrs("EPSG:32630").geodetic(np.array([[700_000.0, 5_633_000.0, 0.0]]))[0]
    assert abs(result.origin.latitude_deg - middle.latitude_deg) < 1e-4
    assert result.residuals.control_rms_m < 0.05  # the grid's scale and turn are in the similarity
