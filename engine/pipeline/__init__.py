"""The whole engine: back end once a frame, front end once a pose; and rendering of files."""
