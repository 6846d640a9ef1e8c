"""A database with a part of another's images and pairs: COLMAP reads and writes databases as a whole."""

import contextlib
import sqlite3
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pycolmap

from fvs_engine.sfm.colmap.database import delete_database, pair_number

Pair = tuple[int, int]
ImageTable = Literal["keypoints", "descriptors"]
PairTable = Literal["matches", "two_view_geometries"]


def matches_around(database: Path) -> Path:
    """Path of the temporary part of a growing reconstruction's ``database`` for registering an image."""
    return database.with_name("around.db")


@dataclass(frozen=True)
class Part:
    """A part of a database: the images with these ids and the pairs of ids, as far as it has them.

    ``of_images`` and ``of_pairs`` are the tables that are copied, beside images and cameras. ``named_by_id``:
    names become the ids, which have no white space.
    """

    images: Collection[int]
    pairs: Collection[Pair]
    of_images: Sequence[ImageTable] = ()
    of_pairs: Sequence[PairTable] = ()
    named_by_id: bool = False


def write_part(path: Path, whole: Path, part: Part) -> None:
    """Write a part of the database ``whole`` to a new one."""
    delete_database(path)  # of a run that was killed
    pycolmap.Database.open(path).close()  # makes the tables
    with attached(path, whole, durable=False) as db:
        db.execute("CREATE TEMP TABLE wanted (image_id INTEGER PRIMARY KEY)")
        db.executemany("INSERT INTO wanted VALUES (?)", [(image_id,) for image_id in part.images])
        for table in ("cameras", "rigs", "rig_sensors"):
            db.execute(f"INSERT INTO {table} SELECT * FROM other.{table}")
        frames = f"data_id IN wanted AND sensor_type = {int(pycolmap.SensorType.CAMERA)}"
        db.execute(f"INSERT INTO frame_data SELECT * FROM other.frame_data WHERE {frames}")
        some = "frame_id IN (SELECT frame_id FROM frame_data)"
        db.execute(f"INSERT INTO frames SELECT * FROM other.frames WHERE {some}")
        name = "CAST(image_id AS TEXT)" if part.named_by_id else "name"
        named = f"image_id, {name}, camera_id"
        db.execute(f"INSERT INTO images SELECT {named} FROM other.images WHERE image_id IN wanted")
        for image_table in part.of_images:
            db.execute(
                f"INSERT INTO {image_table} SELECT * FROM other.{image_table} WHERE image_id IN wanted"
            )
        numbers = [(pair_number(*pair),) for pair in part.pairs]
        for pair_table in part.of_pairs:
            db.executemany(
                f"INSERT INTO {pair_table} SELECT * FROM other.{pair_table} WHERE pair_id = ?", numbers
            )


def differing_features(path: Path, other: Path) -> list[str]:
    """The names of the images whose features in the database ``path`` are not those in ``other``."""
    if not path.exists():
        return []
    query = (
        "SELECT images.name FROM images JOIN keypoints USING (image_id) JOIN other.images AS theirs "
        "ON theirs.name = images.name JOIN other.keypoints AS their_keypoints "
        "ON their_keypoints.image_id = theirs.image_id WHERE keypoints.data IS NOT their_keypoints.data"
    )
    with attached(path, other) as db:
        return [name for (name,) in db.execute(query)]


@contextlib.contextmanager
def attached(path: Path, other: Path, *, durable: bool = True) -> Iterator[sqlite3.Connection]:
    """A transaction on the database ``path``, with a second one as ``other``.

    One that is not ``durable`` may be damaged when the machine, not the process, stops at once.
    """
    with contextlib.closing(sqlite3.connect(path, timeout=5.0)) as db:
        if not durable:
            db.execute("PRAGMA synchronous = OFF")
        db.execute("ATTACH ? AS other", (str(other),))
        with db:
            yield db
