"""Following features through video."""
