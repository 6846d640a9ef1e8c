"""Signed messages: https://mavlink.io/en/guide/message_signing.html."""

import time
from typing import Any

_BEGAN_2015_S = 1_420_070_400
_TICKS_PER_S = 100_000


def sign_by(key: bytes | None, voice: Any) -> None:
    """Have a pymavlink ``MAVLink`` sign by a key of 32 bytes, and take no other messages; None: neither."""
    voice.signing.secret_key = key
    voice.signing.sign_outgoing = key is not None
    keep_time(voice)


def keep_time(voice: Any) -> None:
    """Continue its time, by which receivers recognise messages that are sent again."""
    now = int((time.time() - _BEGAN_2015_S) * _TICKS_PER_S)
    voice.signing.timestamp = max(voice.signing.timestamp, now)
