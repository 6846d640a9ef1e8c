"""The owner of a blob store: a blob names the one database whose blobs it has.

For ``fvs doctor``, a blob of another database is a blob without a row. So the first service that starts with
a store marks it, and the service of another database does not start with it. A copy of the database, such as
a restored backup, has the same identity.
"""

from sqlalchemy import select

from fvs_service.errors import NotFoundError, StorageRefusedError
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database
from fvs_service.storage.tables import IdentityRow, ImageRow, RemovalRow

OWNER_KEY = "owner"
"""The key of the blob with the identity of the database."""


def claim_store(database: Database, blobs: Blobs) -> None:
    """Mark the store as the database's if it has no owner; raises as ``require_own_store`` does.

    Raises ``StorageRefusedError`` also when the store has blobs and the database has never had an image.
    """
    if require_own_store(database, blobs):
        return
    if knows_no_image(database) and next(blobs.below("scenes/"), None) is not None:
        raise StorageRefusedError(
            "The database knows no images, and the blob store has some.",
            hint="Check --root, FVS_DATABASE_URL and FVS_BLOBS__URL. If the database is lost, restore a "
            "backup.",
        )
    blobs.put(_identity(database).encode(), OWNER_KEY)


def require_own_store(database: Database, blobs: Blobs) -> bool:
    """Whether the store is marked as the database's; False when it has no owner.

    Raises ``StorageRefusedError`` when it is marked as another database's.
    """
    try:
        owner = blobs.read(OWNER_KEY).decode()
    except NotFoundError:
        return False
    if owner != _identity(database):
        raise StorageRefusedError(
            "The blob store belongs to another database.",
            hint="Check --root, FVS_DATABASE_URL and FVS_BLOBS__URL: two services need two buckets, or two "
            "prefixes in one. If the other database is lost, or was this one until a backup without an "
            f"identity was restored, delete the blob {OWNER_KEY!r}.",
        )
    return True


def knows_no_image(database: Database) -> bool:
    """Whether the database has no image, and no record of one that was deleted."""
    with database.reading() as session:
        image = session.scalar(select(ImageRow.sha256).limit(1))
        return image is None and session.scalar(select(RemovalRow.key).limit(1)) is None


def _identity(database: Database) -> str:
    with database.reading() as session:
        return session.execute(select(IdentityRow.id)).scalar_one()
