"""Frames from files and cameras, and files that are written whole."""
