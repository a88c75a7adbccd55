"""Gain design: from `design.toml` and its mission to load images and their provenance."""
