"""Webhooks in the database: a row has all of the state of its deliveries.

A gateway claims a webhook by moving ``not_before_ms`` into the future; it has it until then, or until another
one has claimed it.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy import delete, exists, func, select, update
from sqlalchemy.orm import Session

from fvs_schema.events import EventKind
from fvs_schema.webhooks import Webhook, WebhookState
from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.storage.clock import now, now_ms
from fvs_service.storage.tables import EventRow, WebhookRow

GIVE_UP_AFTER = timedelta(days=3)
"""A webhook whose deliveries fail for this time is disabled."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 5, 3_600
ALWAYS = frozenset({EventKind.EVENTS_DELETED.value})


@dataclass(frozen=True)
class Claim:
    """A webhook that a gateway delivers, until ``not_before_ms``."""

    id: str
    scene_id: str
    url: str
    secret: str
    kinds: frozenset[str]
    delivered: int
    not_before_ms: int


def webhook_of(session: Session, principal: Principal, webhook_id: str) -> WebhookRow:
    """A webhook of the principal's tenant; raises ``NotFoundError``."""
    row = session.get(WebhookRow, webhook_id)
    if row is None or not principal.owns(row.tenant_id, row.scene_id):
        raise NotFoundError("There is no such webhook.")
    return row


def webhooks_of_scene(session: Session, scene_id: str) -> tuple[Webhook, ...]:
    """The webhooks of a scene, the oldest first."""
    rows = session.scalars(
        select(WebhookRow)
        .where(WebhookRow.scene_id == scene_id)
        .order_by(WebhookRow.created_at, WebhookRow.id)
    )
    return tuple(to_webhook(session, row) for row in rows)


def to_webhook(session: Session, row: WebhookRow) -> Webhook:
    """The webhook of a row."""
    pending = select(func.count()).where(
        EventRow.scene_id == row.scene_id, EventRow.number > row.delivered, EventRow.kind.in_(row.kinds)
    )
    state = WebhookState.FAILING if row.failures else WebhookState.ACTIVE
    return Webhook(
        id=row.id,
        scene_id=row.scene_id,
        url=row.url,
        events=tuple(map(EventKind, row.kinds)),
        state=WebhookState.DISABLED if row.disabled else state,
        delivered=row.delivered,
        pending=session.scalar(pending) or 0,
        failures=row.failures,
        failing_since=row.failing_since,
        error=row.error,
        created_at=row.created_at,
        delivered_at=row.delivered_at,
    )


def due_webhooks(session: Session, but: Collection[str], limit: int) -> tuple[str, ...]:
    """The ids of webhooks that have something to deliver now, those that wait for longest first."""
    waiting = exists().where(EventRow.scene_id == WebhookRow.scene_id, EventRow.number > WebhookRow.delivered)
    query = select(WebhookRow.id).where(
        ~WebhookRow.disabled, WebhookRow.not_before_ms <= now_ms(), WebhookRow.id.not_in(but), waiting
    )
    return tuple(session.scalars(query.order_by(WebhookRow.not_before_ms, WebhookRow.id).limit(limit)))


def claim(session: Session, webhook_id: str, lease_ms: int) -> Claim | None:
    """Claim a webhook that is due; None if another gateway has it."""
    row = session.scalars(
        update(WebhookRow)
        .where(WebhookRow.id == webhook_id, ~WebhookRow.disabled, WebhookRow.not_before_ms <= now_ms())
        .values(not_before_ms=now_ms() + lease_ms)
        .returning(WebhookRow)
    ).one_or_none()
    if row is None:
        return None
    kinds = frozenset(row.kinds) | ALWAYS
    return Claim(row.id, row.scene_id, row.url, row.secret, kinds, row.delivered, row.not_before_ms)


def record_delivery(session: Session, claimed: Claim, number: int, *, sent: bool) -> bool:
    """Record that the events up to ``number`` are dealt with; False if the claim is lost."""
    values: dict[str, Any] = {"delivered": number}
    if sent:
        values |= {"failures": 0, "failing_since": None, "error": None, "delivered_at": now()}
    return _change(session, claimed, values)


def record_failure(session: Session, claimed: Claim, error: str) -> None:
    """Record a failed attempt: the next one is due after a pause, or none is, after ``GIVE_UP_AFTER``."""
    row = session.get(WebhookRow, claimed.id, populate_existing=True)
    if row is None:
        return
    since = row.failing_since or now()
    pause_s = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2 ** min(row.failures, 20))
    values = {
        "failures": row.failures + 1,
        "failing_since": since,
        "error": error[:500],
        "disabled": now() - since >= GIVE_UP_AFTER,
        "not_before_ms": now_ms() + round(1_000 * pause_s),
    }
    _change(session, claimed, values)


def release(session: Session, claimed: Claim) -> None:
    """End a claim; the webhook is due again once it has an event."""
    _change(session, claimed, {"not_before_ms": 0})


def remove(session: Session, webhook_id: str) -> None:
    """Delete a webhook."""
    session.execute(delete(WebhookRow).where(WebhookRow.id == webhook_id))


def _change(session: Session, claimed: Claim, values: Mapping[str, Any]) -> bool:
    changed = session.execute(
        update(WebhookRow)
        .where(WebhookRow.id == claimed.id, WebhookRow.not_before_ms == claimed.not_before_ms)
        .values(**values)
        .returning(WebhookRow.id)
    )
    return changed.one_or_none() is not None
