"""What every room may use and that knows none: stages, lazy attributes, threads."""
