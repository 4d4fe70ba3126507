"""Frames from videos, folders and cameras; prefetching, atomic files and the disk cache."""
