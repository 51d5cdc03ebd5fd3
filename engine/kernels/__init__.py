"""Compiled kernels over plain arrays and scalars; they hold no state and import nothing of ours."""
