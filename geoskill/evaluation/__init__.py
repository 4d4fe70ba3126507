"""Evaluation of a skill against ground truth."""
