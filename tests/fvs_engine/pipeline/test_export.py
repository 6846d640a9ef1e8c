"""Exports of a small model with GPS, read back by other programs' libraries."""

import hashlib
import json
import shutil
import struct
import zipfile
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pycolmap
import pyproj
import pytest
import torch
from floating import with_one_before
from georeferenced_folder import CAMERA, MODEL_FROM_WORLD, TO_ECEF, GeoreferencedFolder
from PIL import Image
from plyfile import PlyData
from random_gaussians import random_gaussians

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform, SimilarityTransform, quaternion_from_matrix
from fvs_engine.geometry.geodetic import GeodeticPosition, ecef_from_enu, geodetic_from_enu
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.export import export_model
from fvs_engine.pipeline.export_source import opened
from fvs_engine.pipeline.model import full_size_views, read_undistorted
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.snapshot_cameras import intrinsics_of
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.ply import write_ply
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.scenes import AlignmentStatus, Origin
from fvs_schema.snapshots import SnapshotAlignment, SnapshotCameras, SnapshotView

HOME = GeodeticPosition(50.82, -0.14, 80.0)
ENU_FROM_GLTF = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> GeoreferencedFolder:
    return GeoreferencedFolder(tmp_path_factory.mktemp("made"), HOME)


@pytest.fixture(scope="module")
def exported(made: GeoreferencedFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exported")
    export_model(made.root, geoid=45.5, out=folder)
    return folder


def _read(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text())


def _ecef_from_world(folder: Path) -> RigidTransform:
    return RigidTransform.from_matrix(_read(folder, "georeference.json")["ecef_from_world"])


def test_cameras_are_where_they_were(made: GeoreferencedFolder, exported: Path) -> None:
    """By COLMAP, the list of 3DGS and GeoJSON; heights have the geoid."""
    up = _ecef_from_world(exported).rotation[:, 2]
    found = {name: made.ecef(name) + 45.5 * up for name in made.cameras}
    model = pycolmap.Reconstruction(exported / "colmap")
    assert len(model.images) == len(made.cameras)
    assert len(model.points3D) == 200
    place = _ecef_from_world(exported).apply
    for image in model.images.values():
        np.testing.assert_allclose(place(image.projection_center()), found[image.name], atol=1e-3)
    for camera in _read(exported, "cameras.json"):
        name = camera["img_name"]
        np.testing.assert_allclose(place(camera["position"]), found[name], atol=1e-3)
        np.testing.assert_allclose(camera["rotation"], made.cameras[name].rotation, atol=1e-4)
    points = [
        feature
        for feature in _read(exported, "cameras.geojson")["features"]
        if feature["properties"]["kind"] == "camera"
    ]
    assert len(points) == len(made.cameras)
    for feature in points:
        assert feature["properties"]["altitude_datum"] == "ellipsoid"
        np.testing.assert_allclose(
            TO_ECEF.transform(*feature["geometry"]["coordinates"]),
            found[feature["properties"]["name"]],
            atol=1e-3,
        )


def test_points_have_their_crs_and_heights(made: GeoreferencedFolder, exported: Path) -> None:
    cloud = laspy.read(exported / "points.laz")
    crs = cloud.header.parse_crs()
    assert crs.name == "WGS 84 / UTM zone 30N"
    assert [axis.name for axis in crs.axis_info][2] == "Ellipsoidal height"
    transformer = pyproj.Transformer.from_crs(crs, 4978, always_xy=True)
    found = np.stack(transformer.transform(np.asarray(cloud.x), np.asarray(cloud.y), np.asarray(cloud.z)), 1)
    transform = _ecef_from_world(exported)
    positions = np.array([geodetic_from_enu(point, HOME).altitude_m for point in made.points])
    np.testing.assert_allclose(cloud.z, positions + 45.5, atol=1.5e-3)
    truth = np.array(
        [
            TO_ECEF.transform(here.longitude_deg, here.latitude_deg, here.altitude_m)
            for here in (geodetic_from_enu(point, HOME) for point in made.points)
        ]
    )
    assert np.linalg.norm(found - truth - 45.5 * transform.rotation[:, 2], axis=1).max() < 2e-3


def test_gaussians_are_small_numbers_in_every_format(made: GeoreferencedFolder, exported: Path) -> None:
    before = PlyData.read(str(made.root / "splat" / "point_cloud.ply"))["vertex"]
    truth = MODEL_FROM_WORLD.inverse().apply(np.stack([before[axis] for axis in "xyz"], axis=1))
    vertices = PlyData.read(str(exported / "point_cloud.ply"))["vertex"]
    in_world = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    origin = np.mean(in_world - truth, axis=0)  # the world's is the middle of the cameras
    np.testing.assert_allclose(in_world, truth + origin, atol=1e-3)
    document, binary = _glb(exported / "point_cloud.glb")
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    position = document["accessors"][attributes["POSITION"]]
    offset = document["bufferViews"][position["bufferView"]]["byteOffset"]
    stored = np.frombuffer(binary, "<f4", 300, offset).reshape(-1, 3)
    np.testing.assert_allclose(stored @ ENU_FROM_GLTF.T, in_world, atol=1e-4)
    transform = np.reshape(_read(exported, "tileset.json")["root"]["transform"], (4, 4)).T
    np.testing.assert_allclose(transform, _ecef_from_world(exported).matrix)


def _glb(path: Path) -> tuple[Any, bytes]:
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def test_the_record_lays_the_world_into_the_crs(exported: Path) -> None:
    record = _read(exported, "georeference.json")
    crs, place = record["crs"], _ecef_from_world(exported)
    assert (crs["epsg"], record["origin"]["altitude_datum"], record["geoid_height_m"]) == (
        32630,
        "ellipsoid",
        45.5,
    )
    to_crs = pyproj.Transformer.from_crs(4978, 32630, always_xy=True)
    for east, north in ((30.0, 0.0), (0.0, 30.0)):
        turn = np.deg2rad(crs["convergence_deg"])
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [east, north]
        laid = crs["scale_factor"] * turned + [crs["easting_m"], crs["northing_m"]]
        np.testing.assert_allclose(to_crs.transform(*place.apply([east, north, 0.0]))[:2], laid, atol=2e-3)


def test_floaters_are_left_out_on_request(made: GeoreferencedFolder, tmp_path: Path) -> None:
    root, found = tmp_path / "folder", list[Finding]()
    shutil.copytree(made.root, root)
    undistorted = read_undistorted(Workspace(root))
    ground = initialise_from_points(undistorted.points.xyz, undistorted.points.colors, 0)
    gaussians = with_one_before(full_size_views(undistorted)[0], 0.1, ground)
    write_ply(root / "splat" / "point_cloud.ply", gaussians)
    monitor = Monitor(on_warning=found.append)
    for clean, count in ((False, 201), (True, 200)):
        export_model(root, formats=["ply"], frame="model", clean=clean, out=tmp_path / "out", monitor=monitor)
        assert len(PlyData.read(str(tmp_path / "out" / "point_cloud.ply"))["vertex"]) == count
    assert [finding.code for finding in found] == [FindingCode.FLOATERS_REMOVED]


def test_masks_of_an_output_folder_count_for_its_floaters(made: GeoreferencedFolder, tmp_path: Path) -> None:
    root = tmp_path / "folder"
    shutil.copytree(made.root, root)
    for place, size in (("images/0.jpg", "RGB"), ("masks/0.jpg.png", "L")):
        file = root / "undistorted" / place
        file.parent.mkdir(parents=True)
        Image.new(size, (400, 300), "white").save(file)
    with Image.open(file) as mask:
        mask.paste(0, (0, 0, 400, 150))
        mask.save(file)
    with opened(root) as source:
        masks = source.read_masks()
    assert {name: float(mask.mean()) for name, mask in masks.items()} == {"0.jpg": 0.5}


def test_without_a_geoid_heights_are_above_sea_level(made: GeoreferencedFolder, tmp_path: Path) -> None:
    warnings: list[Finding] = []
    monitor = Monitor(on_warning=warnings.append)
    export_model(made.root, formats=["3d-tiles", "geojson", "laz"], out=tmp_path, monitor=monitor)
    assert [warning.code for warning in warnings] == [FindingCode.HEIGHTS_NOT_ELLIPSOIDAL]
    crs = laspy.read(tmp_path / "points.laz").header.parse_crs()
    assert crs.sub_crs_list[1].to_epsg() == 5714  # MSL height
    camera = _read(tmp_path, "cameras.geojson")["features"][0]
    assert len(camera["geometry"]["coordinates"]) == 2
    assert camera["properties"]["altitude_m"] == pytest.approx(125.0, abs=0.01)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("tileset.json", "tile.glb", "cameras.geojson", "points.laz", "georeference.json")
    }


def test_gaussians_far_away_make_spz_coarse(made: GeoreferencedFolder, tmp_path: Path) -> None:
    root = shutil.copytree(made.root, tmp_path / "made")
    gaussians = random_gaussians(20, 0)
    gaussians.means[3] = torch.tensor([400.0, 0.0, 0.0])  # 20 km
    write_ply(root / "splat" / "point_cloud.ply", gaussians)
    warnings: list[Finding] = []
    export_model(root, formats=["spz"], out=tmp_path / "out", monitor=Monitor(on_warning=warnings.append))
    (warning,) = warnings
    assert warning.code is FindingCode.COARSE_POSITIONS
    assert warning.numbers["step_m"] == 2.0**-8
    assert 10_000.0 < warning.numbers["farthest_m"] < 21_000.0


@pytest.mark.parametrize(
    ("home", "codes"),
    [
        (GeodeticPosition(-17.0, 180.0, 20.0), {32701, 32760}),
        (GeodeticPosition(89.9998, 12.0, 20.0), {5041}),
        (GeodeticPosition(-90.0, 0.0, 2800.0), {5042}),
    ],
)
def test_scenes_at_the_antimeridian_and_the_poles(
    tmp_path: Path, home: GeodeticPosition, codes: set[int]
) -> None:
    made, out = GeoreferencedFolder(tmp_path / "made", home), tmp_path / "out"
    export_model(made.root, formats=["cameras", "geojson", "laz"], out=out)
    assert _read(out, "georeference.json")["crs"]["epsg"] in codes
    place = _ecef_from_world(out).apply
    for camera in _read(out, "cameras.json"):
        np.testing.assert_allclose(place(camera["position"]), made.ecef(camera["img_name"]), atol=5e-3)
    footprints = [feature["geometry"] for feature in _read(out, "cameras.geojson")["features"][1::2]]
    assert {footprint["type"] for footprint in footprints} >= {"MultiPolygon"}
    cloud = laspy.read(out / "points.laz")
    assert np.hypot(np.ptp(cloud.x), np.ptp(cloud.y)) < 240.0


def test_the_model_frame_needs_no_place(made: GeoreferencedFolder, tmp_path: Path) -> None:
    manifest = made.root / "manifest.json"
    root = shutil.copytree(made.root, tmp_path / "made")
    document = json.loads(manifest.read_text())
    document["settings"]["gps"] = False
    (root / "manifest.json").write_text(json.dumps(document))
    paths = export_model(root, frame="model", out=tmp_path / "out")
    assert [path.name for path in paths] == [
        *("point_cloud.ply", "point_cloud.spz", "point_cloud.glb", "cameras.json", "colmap")
    ]
    cameras = _read(tmp_path / "out", "cameras.json")
    expected = MODEL_FROM_WORLD.apply(made.cameras["0.jpg"].translation)
    np.testing.assert_allclose(cameras[0]["position"], expected, atol=1e-9)
    with pytest.raises(InvalidInputError, match="without the positions") as refused:
        export_model(root, out=tmp_path / "out")
    assert "model frame" in refused.value.hint
    with pytest.raises(InvalidInputError, match="laz needs a place on Earth"):
        export_model(root, formats=["ply", "laz"], frame="model", out=tmp_path / "out")


def test_photographs_without_gps_have_no_place(made: GeoreferencedFolder, tmp_path: Path) -> None:
    root = shutil.copytree(made.root, tmp_path / "made")
    for path in (root / "images").iterdir():
        Image.new("RGB", (8, 8)).save(path)
    with pytest.raises(InvalidInputError, match="of its 9 photographs 0 have a position"):
        export_model(root, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_nothing_is_written_when_a_crs_or_geoid_cannot_be_used(
    made: GeoreferencedFolder, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match="no CRS with the code EPSG:99999"):
        export_model(made.root, epsg=99_999, out=tmp_path / "out")
    with pytest.raises(InvalidInputError, match=r"EPSG:25832 .* is not for 50\.8"):
        export_model(made.root, epsg=25_832, out=tmp_path / "out")
    with pytest.raises(InvalidInputError, match="there is no such file") as refused:
        export_model(made.root, geoid=tmp_path / "none.gtx", out=tmp_path / "out")
    assert refused.value.path == tmp_path / "none.gtx"
    assert not (tmp_path / "out").exists()


def _snapshot(made: GeoreferencedFolder, folder: Path, origin: Origin | None) -> Path:
    """The artifacts of a snapshot of the same model, whose world has its origin at ``origin``."""
    folder.mkdir()
    shutil.copyfile(made.root / "splat" / "point_cloud.ply", folder / "point_cloud.ply")
    with zipfile.ZipFile(folder / "colmap.zip", "w") as archive:
        for name in ("cameras", "images", "points3D"):
            file = made.root / "undistorted" / "sparse" / f"{name}.bin"
            archive.write(file, f"sparse/0/{name}.bin")
    poses = {name: MODEL_FROM_WORLD.move_camera(camera) for name, camera in made.cameras.items()}
    cameras = SnapshotCameras(
        camera=intrinsics_of(CAMERA),
        views=tuple(
            SnapshotView(
                image=f"sha256:{hashlib.sha256(name.encode()).hexdigest()}",
                name=name,
                position=tuple(pose.translation.tolist()),
                orientation_wxyz=tuple(quaternion_from_matrix(pose.rotation).tolist()),
            )
            for name, pose in poses.items()
        ),
        **dict.fromkeys(("centre", "up", "lower", "upper"), (0.0, 0.0, 0.0)),
    )
    (folder / "cameras.json").write_text(cameras.model_dump_json())
    alignment = SnapshotAlignment(origin=origin)
    if origin is not None:
        there = GeodeticPosition(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
        turn = ecef_from_enu(there).inverse() @ ecef_from_enu(made.home)
        found = SimilarityTransform(1.0, turn.rotation, turn.translation) @ MODEL_FROM_WORLD.inverse()
        alignment = SnapshotAlignment(
            origin=origin,
            status=AlignmentStatus.ALIGNED,
            scale=found.scale,
            rotation_wxyz=tuple(quaternion_from_matrix(found.rotation).tolist()),
            translation=tuple(found.translation.tolist()),
        )
    (folder / "alignment.json").write_text(alignment.model_dump_json())
    return folder


@pytest.mark.parametrize("north_deg", [0.0, 0.5])
def test_a_snapshot_is_exported_near_its_scene(
    made: GeoreferencedFolder, tmp_path: Path, north_deg: float
) -> None:
    """Also when the world's origin is 55 km away, which float32 would round to 4 mm."""
    origin = Origin(latitude_deg=50.82 + north_deg, longitude_deg=-0.14, altitude_m=80.0)
    root = _snapshot(made, tmp_path / "snapshot", origin)
    export_model(root, formats=["ply", "cameras"], out=tmp_path / "out")
    place = _ecef_from_world(tmp_path / "out").apply
    for camera in _read(tmp_path / "out", "cameras.json"):
        np.testing.assert_allclose(place(camera["position"]), made.ecef(camera["img_name"]), atol=1e-3)
    vertices = PlyData.read(str(tmp_path / "out" / "point_cloud.ply"))["vertex"]
    assert max(np.abs(vertices[axis]).max() for axis in "xyz") < 300.0
    record = _read(tmp_path / "out", "georeference.json")
    assert record["origin"]["latitude_deg"] == pytest.approx(50.82, abs=0.001)


def test_snapshots_that_cannot_be_exported(made: GeoreferencedFolder, tmp_path: Path) -> None:
    root = _snapshot(made, tmp_path / "snapshot", None)
    with pytest.raises(InvalidInputError, match="no place on Earth"):
        export_model(root)
    assert len(export_model(root, frame="model")) == 5
    with pytest.raises(InvalidInputError, match="the model itself"):
        export_model(root, frame="model", out=tmp_path / "snapshot")
    (root / "colmap.zip").write_bytes(b"cut off")
    with pytest.raises(InvalidInputError, match=r"colmap\.zip cannot be used") as refused:
        export_model(root, frame="model")
    assert "Download" in refused.value.hint
    above_takeoff = Origin(latitude_deg=50.82, longitude_deg=-0.14, altitude_m=0.0, altitude_datum="takeoff")
    root = _snapshot(made, tmp_path / "takeoff", above_takeoff)
    with pytest.raises(InvalidInputError, match="above the place of takeoff"):
        export_model(root, geoid=45.5)
