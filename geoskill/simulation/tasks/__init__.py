"""The four tasks of the paper, one file each, named like the task."""
