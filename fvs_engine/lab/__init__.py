"""The laboratory: simulated sites and vehicles, selectors for comparison, and their evaluation."""
