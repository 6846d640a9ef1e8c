"""Reconstruction of a fixed set of images."""
