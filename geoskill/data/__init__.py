"""Demonstrations as training data."""
