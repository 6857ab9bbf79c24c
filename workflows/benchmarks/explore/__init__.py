"""The page of `critflow explore` in a browser: the driver of its tests, and its pictures."""
