"""Kernels of the background model: rays, culling, coverage, maximum depth, the PBI."""
