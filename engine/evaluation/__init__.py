"""Measures of quality, speed and memory. They report figures, which tests check; only clients and tests import them."""
