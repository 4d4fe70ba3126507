"""Tracking of features through video: optical flow, tracks, trajectories, co-motion and appearance."""
