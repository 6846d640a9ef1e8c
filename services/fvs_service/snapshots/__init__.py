"""Snapshots: immutable models of a scene, with their artifacts."""
