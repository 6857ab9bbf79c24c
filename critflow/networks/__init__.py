"""Networks: edges, image offsets, cell and pins; regular lattices and random networks."""
