"""COLMAP's files and database, read and written."""
