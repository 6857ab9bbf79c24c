"""The page of `critflow explore`."""
