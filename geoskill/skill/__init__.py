"""Learned skills: loading, inference, selection over time, and the readable task definition."""
