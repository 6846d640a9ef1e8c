"""Flies a vehicle that speaks MAVLink from view to view: rank, fly, photograph, send, repeat."""
