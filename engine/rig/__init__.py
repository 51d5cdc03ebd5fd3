"""Cameras, depth codings, frames, the viewer's eyes, and which cameras serve a picture."""
