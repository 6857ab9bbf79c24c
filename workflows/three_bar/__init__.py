"""The three-bar linkage."""
