"""Readers of labeled regions, in this project's own format and in those of labeling tools."""
