"""Image metrics and data sets with known cameras."""
