"""Flies a vehicle that speaks MAVLink from view to view: ask, fly, photograph, send, ask again."""
