"""The four tasks of the paper: what lies on the table, and where the object belongs."""
