"""Webhooks: events of scenes, sent to other services."""
