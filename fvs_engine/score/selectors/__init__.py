"""Selectors: they score candidates for the next view; the paper's, and kriging."""
