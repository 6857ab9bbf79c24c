"""Springs on the perimeters of faces, and pressures of faces."""
