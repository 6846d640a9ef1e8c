"""Pairs with guided matches in COLMAP's database, and what they replaced.

A guided pair is evidence only together with the pose that guided it. So it counts while both its images are
registered; until they are, or when the process is killed before, what was there is put back.
"""

import contextlib
import sqlite3
from collections.abc import Collection, Mapping
from pathlib import Path

import pycolmap

from fvs_engine.sfm.colmap.database import image_ids, pair_number

Pair = tuple[int, int]

_TABLES = """
    CREATE TABLE IF NOT EXISTS guided_pairs (pair_id INTEGER PRIMARY KEY, first INTEGER, second INTEGER);
    CREATE TABLE IF NOT EXISTS replaced_geometries AS SELECT * FROM two_view_geometries WHERE 0;
"""
"""Tables of this project's own, which COLMAP does not read."""


def write_guided_pairs(path: Path, geometries: Mapping[Pair, pycolmap.TwoViewGeometry]) -> None:
    """Write two-view geometries by image ids, the smaller one first, and keep those that they replace."""
    numbers = [(pair_number(*pair), *pair) for pair in geometries]
    with contextlib.closing(sqlite3.connect(path, timeout=5.0)) as db:
        db.executescript(_TABLES)
        with db:
            db.executemany("INSERT INTO guided_pairs VALUES (?, ?, ?)", numbers)
            kept = "INSERT INTO replaced_geometries SELECT * FROM two_view_geometries WHERE pair_id = ?"
            db.executemany(kept, [(number,) for number, _, _ in numbers])
    with contextlib.closing(pycolmap.Database.open(path)) as opened:
        for pair, geometry in geometries.items():
            if opened.exists_two_view_geometry(*pair):
                opened.delete_two_view_geometry(*pair)
            opened.write_two_view_geometry(*pair, geometry)


def take_back_guided_pairs(path: Path, registered: Collection[str]) -> None:
    """Put back what guided pairs replaced, unless both their images are ``registered``."""
    ids = image_ids(path)
    posed, known = {ids[name] for name in registered if name in ids}, set(ids.values())
    with contextlib.closing(sqlite3.connect(path, timeout=5.0)) as db:
        if not db.execute("SELECT 1 FROM sqlite_master WHERE name = 'replaced_geometries'").fetchone():
            return
        with db:
            for number, first, second in db.execute("SELECT * FROM guided_pairs").fetchall():
                if {first, second} <= posed:
                    continue
                db.execute("DELETE FROM two_view_geometries WHERE pair_id = ?", (number,))
                if {first, second} <= known:
                    put_back = "SELECT * FROM replaced_geometries WHERE pair_id = ?"
                    db.execute(f"INSERT INTO two_view_geometries {put_back}", (number,))
                for table in ("guided_pairs", "replaced_geometries"):
                    db.execute(f"DELETE FROM {table} WHERE pair_id = ?", (number,))
