"""Checks of a model against the two-view geometries and known positions."""
