"""Ids of requests, which logs and errors have."""

import re

from fvs_service.ids import new_id

HEADER = "x-request-id"
_VALID = re.compile(r"^[A-Za-z0-9._-]{1,64}$")


def request_id_of(offered: str) -> str:
    """The id that the client offers if that is valid, else a new one."""
    return offered if _VALID.match(offered) else new_id("req")
