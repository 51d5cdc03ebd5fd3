"""Helpers that every room may import and that import none: stages, lazy attributes, threads."""
