"""A learned skill: load it, infer with it, describe it."""
