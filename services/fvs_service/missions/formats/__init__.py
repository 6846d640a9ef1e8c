"""The formats of missions, one a file."""
