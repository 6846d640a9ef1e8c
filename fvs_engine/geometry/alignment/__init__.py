"""Alignment of frames: similarity transforms, georeferencing, datasets."""
