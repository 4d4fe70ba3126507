"""From frames to features: detectors, descriptors, tracking, the cache, and reading video."""
