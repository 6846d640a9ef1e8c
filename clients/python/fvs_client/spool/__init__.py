"""The field client: photographs go into an outbox, and to the service when there is a link.

It runs beside a camera, and imports neither the client nor its HTTP library.
"""

from fvs_client.spool.outbox import Outbox
from fvs_client.spool.photograph import Photograph, Refusal, State
from fvs_client.spool.settings import Settings
from fvs_client.spool.spool import Spool

__all__ = ["Outbox", "Photograph", "Refusal", "Settings", "Spool", "State"]
