"""Runs the migrations on the connection that ``Database.migrate`` gives."""

from alembic import context
from fvs_service.storage.tables import Table

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Table.metadata,
    render_as_batch=True,
)
context.run_migrations()
