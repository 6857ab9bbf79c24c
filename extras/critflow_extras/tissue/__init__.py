"""Springs on the perimeters of faces, and pressures of faces."""

from critflow_extras.tissue import path_start as path_start
from critflow_extras.tissue import response as response
