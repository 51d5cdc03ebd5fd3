"""Kernels of depth maps and triangles: cuts, splits, triangulation, completion, reduction."""
