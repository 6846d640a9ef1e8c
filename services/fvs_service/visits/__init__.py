"""Visits: reports of vehicles that they fly to a view, took its photograph, or failed."""
