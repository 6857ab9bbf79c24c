"""A network of the user in place of generated ones: `--set network=FILE`.

The identity of a case contains the file with a digest of its network, FILE@DIGEST, so that other contents are other
cases.  A file that needs a repair is refused: `critflow convert` of critflow-extras repairs it and reports how.
"""

import re
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

import critflow as cf
from critflow import CritflowError, CriticalManifold, InputError, Network
from critflow.extensions import from_extras, has_extras
from critflow.manifold import require_one_stress_by_count
from critflow.points import STANDARD_HARD_CORE, check_voronoi
from critflow.result import StudyError

from .checks import check_network

_DIGEST = re.compile(r"(.+)@([0-9a-f]{16})")


def with_digest(n_vertices, parameters):
    """The parameters with the digest of the network of the file in them, if there is one.

    n_vertices  of generated networks by default: a file has its own, and another number would be ignored
    """
    text = parameters.get("network", "")
    for name, default in (("n_vertices", n_vertices), ("hard_core", STANDARD_HARD_CORE)):
        if text and parameters.get(name, default) != default:
            raise StudyError(f"{name} is of generated networks, and the network of a file has its own: leave it out")
    return {**parameters, "network": _identified(text)} if text else parameters


def own_network(parameters):
    """The network of the file in the parameters, or None."""
    text = parameters.get("network", "")
    return _read(text) if text else None


@lru_cache(maxsize=2)
def own_manifold(text):
    """The manifold of the network of FILE@DIGEST, with the analysis of its matrices."""
    return CriticalManifold(_read(text))


def check_own(network, *, planar_faces_needed=False):
    """Raise `StudyError` unless a network is periodic in the plane and generic stresses give it one self-stress."""
    if network.cell is None or network.dimension != 2:
        raise StudyError("network: this study needs a periodic network in the plane, to deform its cell: give one")
    try:
        require_one_stress_by_count(network)
    except CritflowError as error:
        raise StudyError(f"network: {error}") from error
    if planar_faces_needed and network.faces is None:
        raise StudyError("network: this study needs the faces of a network without crossing edges: give such a one")
    if planar_faces_needed and (np.bincount(network.edges.ravel()) != 3).any():
        raise StudyError("network: this study changes faces, which needs three edges at every vertex: give such a one")


def check_planar(parameters, *, planar_faces_needed=False):
    """Raise `StudyError` unless the network of the file, or generated ones of the parameters, suit the study."""
    if network := own_network(parameters):
        check_own(network, planar_faces_needed=planar_faces_needed)
    else:
        check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


def _identified(text):
    """FILE@DIGEST of FILE, or of FILE@DIGEST if its network is still the same."""
    given = _DIGEST.fullmatch(text)
    file = given[1] if given else text
    found = f"{file}@{_digest(_network_of(file))}"
    if given and found != text:
        raise StudyError(f"{file} contains another network than {text}: give --set network={file} for new cases")
    return found


@lru_cache(maxsize=2)
def _read(text):
    """The network of FILE@DIGEST."""
    _identified(text)
    return _network_of(_DIGEST.fullmatch(text)[1])


def _network_of(file) -> Network:
    """The network of a file that needs no repair, with its faces if no edges cross.

    Tables are read without critflow-extras, which reads the other formats, and tables of other columns.
    """
    if not Path(file).suffix:
        raise StudyError(f"network={file} must be a file whose ending names its format, such as tissue.csv")
    try:
        return cf.read_network(file)
    except InputError as error:
        refused = error
    try:
        return from_extras("network_from", "networks of files")(file, strict=True).network
    except CritflowError as error:
        # Of tables the first sentence says which edge it is; other formats are those of the extras.
        if has_extras() and Path(file).suffix not in (".csv", ".tsv", ".txt"):
            raise StudyError(f"network={file}: {error}; critflow convert reads and repairs it") from error
        raise StudyError(f"network={refused}") from refused


def _digest(network):
    arrays = (network.edges, network.offsets, network.cell, network.stiffness, network.positions, *network.pins.items())
    digest = sha256()
    for array in arrays:
        digest.update(repr([] if array is None else np.asarray(array, dtype=object).tolist()).encode())
    return digest.hexdigest()[:16]
