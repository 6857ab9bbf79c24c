"""The ensemble in three dimensions."""
