"""Benchmarks of selection, training and the live pipeline, run as ``python -m geoskill.benchmarks.NAME``."""
