"""Frames as PyTorch Geometric graphs."""
