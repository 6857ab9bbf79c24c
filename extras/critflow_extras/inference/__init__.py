"""The critical configuration nearest to given coordinates: tension inference."""
