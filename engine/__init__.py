"""The engine: renders stereo views of RGB-D video and builds its background model. Opens no socket."""
