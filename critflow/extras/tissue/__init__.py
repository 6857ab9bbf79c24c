"""Springs on the perimeters of faces, and pressures of faces."""

from critflow.extras.tissue import path_start as path_start
from critflow.extras.tissue import response as response
