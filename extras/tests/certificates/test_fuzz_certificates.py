"""Random valid networks through certificates: a sound answer or a sentence."""

from fuzzing import answers_or_explains, critical_of, geometry

from critflow_extras import certify, rigidity, self_stresses
from critflow_extras.certificates.spaces import zero_modes

CALLS = {
    "certify": lambda p, r: certify(critical_of(p)),
    "rigidity": lambda p, r: rigidity(*geometry(p)[:2]),
    "zero_modes": lambda p, r: zero_modes(*geometry(p)[:2]),
    "self_stresses": lambda p, r: self_stresses(critical_of(p)),
}

test_certificates_answer_or_explain = answers_or_explains(CALLS)
