"""The runner: one scene's child process. It learns, and answers rankings while it learns."""
