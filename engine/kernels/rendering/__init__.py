"""Kernels of pictures: drawing triangles, shading, the backdrop, filling, outlines."""
