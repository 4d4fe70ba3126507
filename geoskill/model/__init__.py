"""Networks that score associations."""
