"""Deletion: of scenes, snapshots and rankings, on request and by retention."""
