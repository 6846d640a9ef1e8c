"""Fuzz the parsers of models: ``python tests/fuzz/parsers.py [--minutes M] [--first N] [TARGET ...]``.

``M`` is processor time per target. The report of each is a line of JSON on stdout; the exit status is 1 when
something was found.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pycolmap
import torch

sys.path.insert(0, str(Path(__file__).parent))  # for the children, which import this file by its path
from fuzzing import Files, Target, run

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.pipeline.candidates import read_candidates
from fvs_engine.scene.sparse_points import points_from_pycolmap
from fvs_engine.sfm.colmap.imports import import_colmap
from fvs_engine.sfm.colmap.intrinsics import read_intrinsics
from fvs_engine.sfm.colmap.model import MODEL_FILES, open_colmap
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply, write_ply
from fvs_engine.views import PinholeView


def _gaussians(count: int, degree: int) -> Gaussians:
    generator = torch.Generator().manual_seed(degree)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=generator)

    return Gaussians(
        means=normal(count, 3),
        log_scales=normal(count, 3),
        quaternions_wxyz=normal(count, 4),
        opacity_logits=normal(count),
        sh_dc=normal(count, 3),
        sh_rest=normal(count, (degree + 1) ** 2 - 1, 3),
    )


def _ply_seeds(folder: Path) -> list[Files]:
    folder.mkdir(exist_ok=True)
    for degree in (0, 1, 3):
        write_ply(folder / f"{degree}.ply", _gaussians(5, degree))
    binary = [{"model.ply": (folder / f"{degree}.ply").read_bytes()} for degree in (0, 1, 3)]
    names = ("x", "y", "z", *(f"f_dc_{i}" for i in range(3)), "opacity")
    names += (*(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4)))
    head = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(f"property float {n}\n" for n in names)
    row = " ".join(["0.5"] * len(names))
    lists = "element face 1\nproperty list uchar int vertex_indices\n"
    return [
        *binary,
        {"model.ply": f"{head}end_header\n{row}\n{row}\n".encode()},
        {"model.ply": f"{head}{lists}end_header\n{row}\n{row}\n3 0 1 1\n".encode()},
    ]


def _model() -> pycolmap.Reconstruction:
    model = pycolmap.Reconstruction()
    kinds = {1: ("OPENCV", [90.0, 90.0, 48.0, 32.0, 0.1, 0.0, 0.0, 0.0]), 2: ("SIMPLE_PINHOLE", [90, 48, 32])}
    for number, (kind, params) in kinds.items():
        camera = pycolmap.Camera(model=kind, width=96, height=64, params=params, camera_id=number)
        model.add_camera_with_trivial_rig(camera)
    for number in (1, 2, 3):
        image = pycolmap.Image(name=f"photograph {number}.jpg", camera_id=1 + number % 2, image_id=number)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([10.0, number]))] * 2)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.eye(3)), np.array([0.1 * number, 0.0, 4.0]))
        model.add_image_with_trivial_frame(image, pose)
    for place in range(2):
        track = pycolmap.Track()
        for number in (1, 2, 3):
            track.add_element(number, place)
        model.add_point3D(np.array([0.1, 0.2, 0.3 * place]), track, np.array([9, 8, 7], np.uint8))
    return model


def _colmap_seeds(folder: Path, suffix: str) -> list[Files]:
    folder.mkdir(exist_ok=True)
    model = _model()
    (model.write_binary if suffix == ".bin" else model.write_text)(folder)
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix == suffix}
    whole = {name: content for name, content in files.items() if Path(name).stem in MODEL_FILES}
    return [whole, files]


def _binary_seeds(folder: Path) -> list[Files]:
    return _colmap_seeds(folder, ".bin")


def _text_seeds(folder: Path) -> list[Files]:
    return _colmap_seeds(folder, ".txt")


def _read_colmap(folder: Path) -> object:
    import_colmap(folder)
    model = open_colmap(folder)
    return points_from_pycolmap(model, {image.name: image.name for image in model.images.values()})


def _transforms_seeds(_folder: Path) -> list[Files]:
    matrix = [[1, 0, 0, 0.5], [0, 0, -1, 2], [0, 1, 0, 1e-3], [0, 0, 0, 1]]
    frames = [{"file_path": f"./images/{n}.png", "transform_matrix": matrix} for n in range(3)]
    heads = (
        {"camera_angle_x": 0.9, "w": 96, "h": 64},
        {"fl_x": 90.5, "fl_y": 90, "cx": 48, "cy": 32, "w": 96, "h": 64, "k1": 0.1, "p1": 0.01, "k3": 0.0},
        {"camera_model": "OPENCV_FISHEYE", "fl_x": 50, "w": 96.0, "h": 64.0, "k4": 0.001},
        {"is_fisheye": True, "fl_x": 50, "w": 96, "h": 64, "k1": 0, "k3": 0.01},
    )
    one_by_one = {"frames": [{**frame, **heads[1]} for frame in frames]}
    documents = [*({**head, "frames": frames} for head in heads), one_by_one]
    return [{"transforms.json": json.dumps(document).encode()} for document in documents]


def _candidates_seeds(_folder: Path) -> list[Files]:
    pose = {"position": [0, 0.5, 1e-3], "orientation_wxyz": [1.0, 0, 0, 0]}
    camera = {"width": 96, "height": 64, "fx": 90.0, "fy": 90, "cx": 48.0, "cy": 32}
    entries = [
        {"id": "a", "pose": pose},
        {"id": "b", "pose": pose, "camera": camera},
        {"id": "c", "view": "0.png"},
    ]
    matrix = np.eye(4)
    frames = []
    for number, centre in enumerate(([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 1, 0])):
        matrix[:3, 3] = centre
        frames.append({"file_path": f"{number}.png", "transform_matrix": matrix.tolist()})
    transforms = {"fl_x": 90, "w": 96, "h": 64, "frames": frames}
    return [{"poses.json": json.dumps(document).encode()} for document in (entries, transforms)]


def _read_candidates(folder: Path) -> object:
    return read_candidates(folder / "poses.json", _views(), {})


def _views() -> list[PinholeView]:
    camera = PinholeCamera(96, 64, 90.0, 90.0, 48.0, 32.0)
    turn = np.diag([1.0, -1.0, -1.0])
    centres = ([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1])
    return [
        PinholeView(f"{number}.png", camera, RigidTransform(turn, np.array(centre, float)).inverse())
        for number, centre in enumerate(centres)
    ]


def _intrinsics_seeds(_folder: Path) -> list[Files]:
    record = {"model": "PINHOLE", "width_px": 96, "height_px": 64, "params": [90, 90, 48, 32]}
    line = b"# a comment\n1 OPENCV 96 64 90 90 48 32 0.1 0 0 0\n"
    return [{"cameras.txt": line}, {"cameras.txt": json.dumps(record).encode()}]


def _read_ply(folder: Path) -> object:
    return read_ply(folder / "model.ply")


def _read_transforms(folder: Path) -> object:
    return import_transforms_json(folder / "transforms.json")


def _read_intrinsics(folder: Path) -> object:
    return read_intrinsics(folder / "cameras.txt").camera()


TARGETS = (
    Target("ply", _ply_seeds, _read_ply),
    Target("colmap-binary", _binary_seeds, _read_colmap),
    Target("colmap-text", _text_seeds, _read_colmap),
    Target("transforms", _transforms_seeds, _read_transforms),
    Target("candidates", _candidates_seeds, _read_candidates),
    Target("intrinsics", _intrinsics_seeds, _read_intrinsics),
)


if __name__ == "__main__":
    sys.exit(run(TARGETS, __doc__))
