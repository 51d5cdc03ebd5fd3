"""Compiling kernels before they are needed, on all cores: which there are, in which order, and how far it is."""
