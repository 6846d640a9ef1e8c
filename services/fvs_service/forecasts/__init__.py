"""Forecasts: what the model of a scene does not know, at poses and over its surface."""
