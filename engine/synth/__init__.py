"""Twins of the test sequences: ray-traced, with ground truth."""
