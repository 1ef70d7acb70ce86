"""The ground as a surface: depth, relief, rays, drawn triangles."""
