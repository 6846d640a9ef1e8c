"""The laboratory: simulated sites and vehicles, and evaluations of selectors."""
