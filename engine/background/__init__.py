"""The probable background surface (paper section 3.3)."""
