"""Files: TMIV sequences, raw video, pose traces, meshes."""
