"""Kernels that the other groups share: vectors, projection, tones, view tables, tolerances."""
