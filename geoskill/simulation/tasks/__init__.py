"""The four tasks of the paper and two for features in space, one file each, named like the task."""
