"""What the paper leaves open, tried on networks: four relations that docs/theory proves or derives."""
