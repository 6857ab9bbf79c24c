"""The onset of rigidity: rest lengths to configurations, under uniform scaling or on any path of strain."""
