"""From depth maps to triangles: meshes, their levels of detail, and Embree's scenes of them."""
