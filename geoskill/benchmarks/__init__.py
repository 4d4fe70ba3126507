"""Times and memory of the work of one frame and of one training step, beside other ways to do the same."""
