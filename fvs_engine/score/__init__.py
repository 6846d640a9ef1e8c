"""Scores of candidate views."""
