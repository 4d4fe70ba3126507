"""Skill kernels, one file per kernel, named as on the command line."""
