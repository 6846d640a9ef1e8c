"""A scene: one capture of one place, its world frame, and who works on it."""
