"""The page of `critflow explore` in a browser: its speed, its pictures, and the cloud of points behind it."""
