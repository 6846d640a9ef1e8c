import shutil
from pathlib import Path

import pycolmap

from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_ids, verified_matches
from fvs_engine.sfm.native.match_cache import load_all, load_around
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES


def test_a_new_image_gets_the_matches_of_those_that_it_matches(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    database = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", database)
    ids, new = image_ids(database), kermit_names[-1]
    pairs = {tuple(ids[name] for name in pair) for pair in verified_matches(database, MIN_PAIR_MATCHES)}
    near = {ids[new]} | {image for pair in pairs for image in pair if ids[new] in pair}
    inside = {pair for pair in pairs if near.issuperset(pair)}
    assert 0 < len(inside) < len(pairs)

    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    whole = load_all(database, kermit_names, model).correspondence_graph
    for suffix in ("", "-wal", "-shm"):
        tmp_path.joinpath(f"around.db{suffix}").write_bytes(b"of a run that was killed")
    cache = load_around(database, kermit_names, [new], model)
    graph = cache.correspondence_graph
    # The database has the camera that mapping started with; COLMAP takes no other than the model's.
    assert {i: camera.model_name for i, camera in cache.cameras.items()} == {1: "RADIAL"}
    assert {cache.image(i).name for i in cache.images} == set(kermit_names)
    assert graph.num_image_pairs() == len(inside)
    for pair in inside:
        assert graph.num_matches_between_images(*pair) == whole.num_matches_between_images(*pair)
    assert not list(tmp_path.glob("around.db*"))


def test_matches_with_images_that_are_not_asked_for_are_left_out(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    database = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", database)
    left_out, *names, new = kermit_names[-4:]
    assert (left_out, new) in verified_matches(database, MIN_PAIR_MATCHES)
    cache = load_around(database, [*names, new], [new], pycolmap.Reconstruction(kermit_sfm.model_dir))
    assert {cache.image(i).name for i in cache.images} == {*names, new}
