"""The onset of rigidity under any deformation."""
