"""The page of `critflow explore` in a browser: its speed and its pictures."""
