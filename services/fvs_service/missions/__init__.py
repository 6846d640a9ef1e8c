"""Missions: views as files that autopilots, ground stations and robots read."""
