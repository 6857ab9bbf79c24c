"""Networks under loads: forces on the vertices and weights of the edges, and their design."""
