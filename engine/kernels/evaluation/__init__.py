"""Kernels that only measurements and ground truth need."""
