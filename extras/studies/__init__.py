"""The studies of critflow-extras."""
