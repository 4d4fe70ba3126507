"""The commands: from configuration to a run."""
