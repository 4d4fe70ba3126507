"""Networks that score the instances of a kernel."""
