"""From meshes to pictures: 3D warping, shading, the backdrop, filling, anti-aliasing."""
