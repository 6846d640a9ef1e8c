"""Photographs on disk: reading, checking, normalising, masks."""
