"""The main jobs, from folders on disk to folders on disk."""
