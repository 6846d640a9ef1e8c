"""The runner: a scene's child process. It trains the model, and ranks with it at the same time."""
