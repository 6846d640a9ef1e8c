from pathlib import Path

import pycolmap

from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import feature_counts, image_cameras, image_ids, verified_matches
from fvs_engine.sfm.colmap.part_database import Part, write_part


def test_a_part_has_its_images_and_pairs_and_nothing_else(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    whole, part = kermit_sfm.model_dir.parent / "database.db", tmp_path / "part.db"
    ids, matches, names = image_ids(whole), verified_matches(whole, 15), kermit_names[:4]
    pair = next(pair for pair in matches if set(pair) <= set(names))
    write_part(
        part,
        whole,
        Part(
            [ids[name] for name in names],
            [(ids[pair[1]], ids[pair[0]])],
            of_images=("keypoints",),
            of_pairs=("two_view_geometries",),
        ),
    )
    assert image_ids(part) == {name: ids[name] for name in names}
    assert image_cameras(part) == {name: image_cameras(whole)[name] for name in names}
    assert feature_counts(part) == {name: feature_counts(whole)[name] for name in names}
    assert verified_matches(part, 15) == {pair: matches[pair]}
    with pycolmap.Database.open(part) as opened:
        assert not opened.exists_descriptors(ids[names[0]])
        assert opened.num_frames() == 4


def test_images_can_be_named_by_their_ids(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    whole, part = kermit_sfm.model_dir.parent / "database.db", tmp_path / "part.db"
    wanted = image_ids(whole)[kermit_names[2]]
    write_part(part, whole, Part([wanted], [], named_by_id=True))
    assert image_ids(part) == {str(wanted): wanted}
