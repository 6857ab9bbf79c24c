"""Networks: edges, image offsets, cell and pins; deformations, faces and checks."""
