"""Evaluation of selectors: image metrics, experiments and their reports."""
