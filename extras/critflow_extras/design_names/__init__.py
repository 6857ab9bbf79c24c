"""Names for design: components of the stress and of the elasticity tensor, lengths of edges, areas of faces."""
