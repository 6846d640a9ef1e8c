"""The jobs of the command line: from folders on disk to folders on disk."""
