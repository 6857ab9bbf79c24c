"""Design of stresses and pressures, for prescribed lengths, areas and tensions of a tissue."""
