"""Benchmarks: they measure, the tests verify."""
