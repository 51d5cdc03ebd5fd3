"""Kernels that ray-trace the twins."""
