"""Exit codes of ``fvs-client``. They are never reassigned; errors' own are in ``error_exit_codes``."""

OK = 0
BUG = 1
USAGE = 2
UNAVAILABLE = 4
"""The service cannot be reached, or cannot answer now."""
SOME_FILES = 10
"""Some files were not uploaded, or cannot be used."""
NOT_FLOWN = 11
"""A flight ended early, for a reason that it names."""
INTERRUPTED = 130
