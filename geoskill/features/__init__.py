"""Feature extraction: detectors and descriptors, the pipeline around them, and its cache."""
