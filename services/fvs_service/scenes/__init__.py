"""Scenes: captures, each with a world frame and the lease of the worker that processes it."""
