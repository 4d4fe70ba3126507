"""Pure functions on points, lines, cameras and poses."""
