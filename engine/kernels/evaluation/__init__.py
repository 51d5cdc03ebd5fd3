"""Kernels that are used only by measurements and for ground truth."""
