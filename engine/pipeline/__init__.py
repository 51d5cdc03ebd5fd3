"""The whole engine: the back end runs once per frame, the front end once per pose; and rendering to files."""
