"""The report of `critflow examine`: whether and why a network is rigid."""
