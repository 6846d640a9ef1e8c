"""Code of the SfM child process: the parent passes job names and JSON, and never imports it."""
