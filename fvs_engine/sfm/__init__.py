"""Structure from motion: poses and sparse points from images."""
