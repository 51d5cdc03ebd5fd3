"""Cameras, depth codings, frames, the viewer's eyes, and the choice of cameras for a picture."""
