"""Command line and clients of the public protocol."""
