"""Overlays, plots and videos."""
