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
    """Record the database as the owner of the store, if it has none.

    Raises ``StorageRefusedError`` as ``require_own_store`` and ``require_known_images`` do.
    """
    if require_own_store(database, blobs):
        return
    require_known_images(database, blobs)
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
            "prefixes in one.",
        )
    return True


def require_known_images(database: Database, blobs: Blobs) -> None:
    """Raise ``StorageRefusedError`` when the store has images and the database has never had one."""
    with database.reading() as session:
        image = session.scalar(select(ImageRow.sha256).limit(1))
        knows_some = image is not None or session.scalar(select(RemovalRow.key).limit(1)) is not None
    if not knows_some and next(blobs.below("scenes/"), None) is not None:
        raise StorageRefusedError(
            "The database knows no images, and the blob store has some.",
            hint="Check --root, FVS_DATABASE_URL and FVS_BLOBS__URL. If the database is lost, restore a "
            "backup; without one, use an empty store.",
        )


def _identity(database: Database) -> str:
    with database.reading() as session:
        return session.execute(select(IdentityRow.id)).scalar_one()
