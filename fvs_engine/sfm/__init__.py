"""Structure from motion: photographs in, cameras and sparse points out."""
