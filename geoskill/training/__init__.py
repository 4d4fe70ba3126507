"""Learning from a demonstration with Lightning."""
