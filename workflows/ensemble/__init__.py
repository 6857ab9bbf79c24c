"""Populations of critical configurations, strained past the transition."""
