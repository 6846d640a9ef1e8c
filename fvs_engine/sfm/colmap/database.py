"""COLMAP's database (an SQLite file): progress, image names, verified pairs, and positions in metadata."""

import contextlib
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.errors import DamagedOutputError, StorageError

_VERIFIED = frozenset({2, 3, 4, 5, 6, 9})
"""COLMAP's TwoViewGeometry configurations that are a geometry (not degenerate, watermark or ambiguous)."""

_VETOED = 7
"""The configuration of vetoed pairs, which have no verified matches; COLMAP's for watermarks."""

_TABLES = frozenset({"cameras", "images", "keypoints", "descriptors", "matches", "two_view_geometries"})

_POSITIONS = """CREATE TABLE IF NOT EXISTS positions
    (image_id INTEGER PRIMARY KEY, latitude_deg REAL, longitude_deg REAL, altitude_m REAL)"""
"""Not COLMAP's, which has positions in its own, but reads fewer of them: nothing reads that table."""

_MAX_IMAGES = 2147483647
"""COLMAP numbers a pair as id1 × this + id2, id1 < id2."""


Geodetic = tuple[float | None, float | None, float | None]
"""Latitude and longitude in degrees, and altitude in m."""


@dataclass(frozen=True, eq=False)
class VerifiedPair:
    """Two images and the matches [M, 2] between them that fit one epipolar geometry.

    ``matches`` index the keypoints of either image.
    """

    first: int
    second: int
    matches: NDArray[np.uint32]


def require_sound_database(path: Path) -> None:
    """Check that no other process uses the database and that it is whole.

    One whose creation was interrupted (by a full disk, a kill) is deleted: it holds nothing yet. Raises
    ``DamagedOutputError`` when it is damaged, ``StorageError`` when it is in use or cannot be opened.
    """
    if not path.exists():
        return
    with _errors_named(path), contextlib.closing(sqlite3.connect(path, timeout=2.0)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        connection.rollback()
        (answer,) = connection.execute("PRAGMA quick_check(1)").fetchone()
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if answer != "ok":
        raise _damaged(path)
    if not tables >= _TABLES:
        for left in (path, path.with_name(f"{path.name}-wal"), path.with_name(f"{path.name}-shm")):
            left.unlink(missing_ok=True)


def _damaged(path: Path) -> DamagedOutputError:
    return DamagedOutputError(
        f"The feature database {path} is damaged.",
        hint=f"Delete {path.name} and run again; features are extracted again.",
        path=path,
    )


@contextlib.contextmanager
def _errors_named(path: Path) -> Iterator[None]:
    """SQLite's errors in the block become ``StorageError``s that name the database and the remedy."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if "locked" in str(error) or "busy" in str(error):
            raise StorageError(
                f"Another process works on {path}.",
                hint="Wait until it ends, or give another output folder.",
                path=path,
            ) from error
        raise StorageError(
            f"The feature database {path} cannot be used: {error}.",
            hint="Check the folder's permissions and the free space on its disk.",
            path=path,
        ) from error
    except sqlite3.DatabaseError as error:
        raise _damaged(path) from error


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[sqlite3.Connection]:
    address = f"{path.absolute().as_uri()}?mode=ro"
    with _errors_named(path), contextlib.closing(sqlite3.connect(address, uri=True, timeout=5.0)) as db:
        yield db


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[sqlite3.Connection]:
    """A transaction."""
    with _errors_named(path), contextlib.closing(sqlite3.connect(path, timeout=5.0)) as db, db:
        yield db


def remove_images(path: Path, names: Iterable[str]) -> None:
    """Delete images with their features, matches and priors; unknown names are ignored."""
    if not path.exists():
        return
    known = image_ids(path)
    numbers = [(known[name],) for name in names if name in known]
    with _writing(path) as db:
        db.execute(_POSITIONS)
        for table in ("keypoints", "descriptors", "images", "positions"):
            db.executemany(f"DELETE FROM {table} WHERE image_id = ?", numbers)
        for table in ("matches", "two_view_geometries"):
            pairs = f"pair_id / {_MAX_IMAGES} = ?1 OR pair_id % {_MAX_IMAGES} = ?1"
            db.executemany(f"DELETE FROM {table} WHERE {pairs}", numbers)
        camera = int(pycolmap.SensorType.CAMERA)
        of_image = f"= ? AND {{}}sensor_type = {camera}"
        db.executemany(f"DELETE FROM pose_priors WHERE corr_data_id {of_image.format('corr_')}", numbers)
        db.executemany(f"DELETE FROM frame_data WHERE data_id {of_image.format('')}", numbers)
        db.execute("DELETE FROM frames WHERE frame_id NOT IN (SELECT frame_id FROM frame_data)")


def veto_pairs(path: Path, pairs: Iterable[tuple[int, int]]) -> None:
    """Take the verified matches of these pairs of image ids away, for mappers and evidence alike.

    The matches themselves are kept, so that pairs that are restored need not be matched again.
    """
    numbers = [(pair_number(*pair),) for pair in pairs]
    with _writing(path) as db:
        vetoed = f"SET rows = 0, data = NULL, config = {_VETOED}"
        db.executemany(f"UPDATE two_view_geometries {vetoed} WHERE pair_id = ?", numbers)


def restore_pairs(path: Path) -> list[tuple[str, str]]:
    """Undo all vetoes; return the pairs of names to verify again.

    A pair is returned at every call until it is verified: the process may be killed before.
    """
    names = {image_id: name for name, image_id in image_ids(path).items()}
    with _writing(path) as db:
        vetoed = f"two_view_geometries WHERE config = {_VETOED} AND rows = 0"  # COLMAP's own keep matches
        db.execute("CREATE TABLE IF NOT EXISTS restored_pairs (pair_id INTEGER PRIMARY KEY)")  # not COLMAP's
        db.execute(f"INSERT OR IGNORE INTO restored_pairs SELECT pair_id FROM {vetoed}")
        db.execute(f"DELETE FROM {vetoed}")
        db.execute("DELETE FROM restored_pairs WHERE pair_id IN (SELECT pair_id FROM two_view_geometries)")
        found = db.execute("SELECT pair_id FROM restored_pairs ORDER BY pair_id").fetchall()
    pairs = [(pair_id // _MAX_IMAGES, pair_id % _MAX_IMAGES) for (pair_id,) in found]
    return [(names[first], names[second]) for first, second in pairs if {first, second} <= names.keys()]


def count_rows(path: Path, table: str) -> int:
    """Rows of ``table`` now, 0 while the file is not ready; for progress, while another process writes."""
    try:
        with _reading(path) as db:
            return int(db.execute(f"SELECT count(*) FROM {table}").fetchone()[0])
    except StorageError:
        return 0


def image_ids(path: Path) -> dict[str, int]:
    """Name → id of the images."""
    with _reading(path) as db:
        return {name: image_id for image_id, name in db.execute("SELECT image_id, name FROM images")}


def focal_length_priors(path: Path) -> dict[int, float]:
    """Camera id → focal length prior in px, for cameras that have one: from EXIF, or given."""
    with pycolmap.Database.open(path) as database:
        cameras = database.read_all_cameras()
    return {
        camera.camera_id: float(camera.mean_focal_length())
        for camera in cameras
        if camera.has_prior_focal_length
    }


def image_cameras(path: Path) -> dict[str, int]:
    """Name → camera id of the images."""
    if not path.exists():
        return {}
    with _reading(path) as db:
        return dict(db.execute("SELECT name, camera_id FROM images"))


def feature_counts(path: Path) -> dict[str, int]:
    """Name → number of features of the images whose features are in the database."""
    with _reading(path) as db:
        query = "SELECT name, rows FROM images JOIN keypoints USING (image_id)"
        return dict(db.execute(query))


def pair_number(first: int, second: int) -> int:
    """COLMAP's number of a pair of image ids."""
    return min(first, second) * _MAX_IMAGES + max(first, second)


def matched_pairs(path: Path) -> set[tuple[int, int]]:
    """The pairs of image ids (smaller first) that are matched and verified, with or without success."""
    with _reading(path) as db:
        ids = [row[0] for row in db.execute("SELECT pair_id FROM two_view_geometries")]
    return {(pair_id // _MAX_IMAGES, pair_id % _MAX_IMAGES) for pair_id in ids}


def verified_pair_count(path: Path, min_matches: int) -> int:
    """The number of pairs with at least ``min_matches`` verified matches."""
    configurations = ",".join(map(str, sorted(_VERIFIED)))
    query = f"SELECT count(*) FROM two_view_geometries WHERE rows >= ? AND config IN ({configurations})"
    with _reading(path) as db:
        return int(db.execute(query, (min_matches,)).fetchone()[0])


def verified_matches(path: Path, min_matches: int) -> dict[tuple[str, str], int]:
    """Pair of names → number of verified matches, for pairs with at least ``min_matches``."""
    names = {image_id: name for name, image_id in image_ids(path).items()}
    verified = verified_ids(path, min_matches)
    return {(names[first], names[second]): rows for (first, second), rows in verified.items()}


def verified_ids(path: Path, min_matches: int) -> dict[tuple[int, int], int]:
    """Pair of image ids, the smaller one first → number of verified matches; in the order of the ids."""
    configurations = ",".join(map(str, sorted(_VERIFIED)))
    query = (
        f"SELECT pair_id, rows FROM two_view_geometries WHERE rows >= ? AND config IN ({configurations}) "
        "ORDER BY pair_id"
    )
    with _reading(path) as db:
        return {
            (pair_id // _MAX_IMAGES, pair_id % _MAX_IMAGES): rows
            for pair_id, rows in db.execute(query, (min_matches,))
        }


def read_verified_pairs(
    path: Path, min_matches: int, around: Collection[str] | None = None
) -> list[VerifiedPair]:
    """The verified pairs, ordered by image ids.

    ``around``: names of images; only the pairs between these and all that form a verified pair with them.
    """
    ids = sorted(verified_ids(path, min_matches))
    if around is not None:
        names = image_ids(path)
        centre = {names[name] for name in around if name in names}
        near = centre.union(*(pair for pair in ids if not centre.isdisjoint(pair)))
        ids = [pair for pair in ids if near.issuperset(pair)]
    with pycolmap.Database.open(path) as database:
        geometries = (database.read_two_view_geometry(*pair) for pair in ids)
        return [
            VerifiedPair(first, second, np.asarray(geometry.inlier_matches))
            for (first, second), geometry in zip(ids, geometries, strict=True)
        ]


def read_keypoints(path: Path, ids: set[int]) -> dict[int, NDArray[np.float64]]:
    """Image id → keypoint positions [K, 2] in px."""
    database = pycolmap.Database.open(path)
    try:
        return {i: np.asarray(database.read_keypoints(i))[:, :2].astype(np.float64) for i in sorted(ids)}
    finally:
        database.close()


def read_descriptors(path: Path, image_id: int) -> NDArray[np.float32]:
    """The SIFT descriptors [K, 128] of an image."""
    database = pycolmap.Database.open(path)
    try:
        return np.asarray(database.read_descriptors(image_id).data, dtype=np.float32).reshape(-1, 128)
    finally:
        database.close()


def add_positions(path: Path, position_of: Callable[[str], Geodetic]) -> None:
    """Store the positions in the metadata of all images of which none was stored yet.

    ``position_of``: name of an image → latitude and longitude in degrees and altitude in m, each None if the
    metadata has none.
    """
    if not path.exists():
        return
    query = "SELECT image_id, name FROM images WHERE image_id NOT IN (SELECT image_id FROM positions)"
    with _writing(path) as db:
        db.execute(_POSITIONS)
        missing = db.execute(query).fetchall()
        rows = [(image_id, *position_of(name)) for image_id, name in missing]
        db.executemany("INSERT INTO positions VALUES (?, ?, ?, ?)", rows)


def gps_positions(path: Path) -> dict[int, NDArray[np.float64]]:
    """Image id → position in its metadata [3], east, north, up in m from the first.

    Images without one, or with a part of one, are left out.
    """
    with _reading(path) as db:
        if db.execute("SELECT 1 FROM sqlite_master WHERE name = 'positions'").fetchone() is None:
            return {}
        whole = "latitude_deg + longitude_deg + altitude_m IS NOT NULL"
        rows = db.execute(f"SELECT * FROM positions WHERE {whole} ORDER BY image_id").fetchall()
    if not rows:
        return {}
    positions = np.array([fix for _, *fix in rows])
    east_north_up = pycolmap.GPSTransform().ellipsoid_to_enu(positions, *positions[0])
    return dict(zip((image_id for image_id, *_ in rows), np.asarray(east_north_up), strict=True))


def delete_database(path: Path) -> None:
    """Remove a database with its journal."""
    for suffix in ("", "-wal", "-shm"):
        Path(f"{path}{suffix}").unlink(missing_ok=True)


def publish(temporary: Path, final: Path) -> None:
    """Rename a finished database, without the journal files of its temporary name."""
    with contextlib.closing(sqlite3.connect(temporary)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for suffix in ("-wal", "-shm"):
        Path(f"{temporary}{suffix}").unlink(missing_ok=True)
    temporary.replace(final)
