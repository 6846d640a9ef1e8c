"""Hooks that run right before and right after a transaction's commit.

SQLAlchemy has events for it; but listening to those of one session takes as long as an insert.
"""

from collections.abc import Callable

from sqlalchemy.orm import Session

_BEFORE, _AFTER = "fvs_before_commit", "fvs_after_commit"


def before_commit(session: Session, act: Callable[[Session], object]) -> None:
    """Call ``act`` at the end of the transaction, in it."""
    session.info.setdefault(_BEFORE, []).append(act)


def after_commit(session: Session, act: Callable[[], object]) -> None:
    """Call ``act`` once the transaction is committed."""
    session.info.setdefault(_AFTER, []).append(act)


def act_before_commit(session: Session) -> None:
    """Call what was given to ``before_commit``."""
    for act in session.info.pop(_BEFORE, ()):
        act(session)


def act_after_commit(session: Session) -> None:
    """Call what was given to ``after_commit``."""
    for act in session.info.pop(_AFTER, ()):
        act()
