"""A reconstruction that new images are registered into."""
