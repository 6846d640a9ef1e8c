"""All that runs in the SfM child process; its parent passes job names and JSON and imports none of it."""
