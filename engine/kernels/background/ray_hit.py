"""RTCRayHit of Embree 4: a ray, and what it hits. The one place that says where in it a number lies.

Words are of four bytes: float32, or uint32 from MASK to FLAGS and from PRIM_ID on. RTCRay is its first half; of a
single ray RTCHitN is the second one.
"""

from __future__ import annotations

__all__ = [
    "ALIGNMENT",
    "DIR_X",
    "DIR_Y",
    "DIR_Z",
    "FLAGS",
    "GEOM_ID",
    "HIT",
    "ID",
    "INST_ID",
    "INST_PRIM_ID",
    "INVALID_ID",
    "MASK",
    "ORG_X",
    "ORG_Y",
    "ORG_Z",
    "PRIM_ID",
    "TFAR",
    "TIME",
    "TNEAR",
    "WORDS",
    "U",
    "V",
]

ORG_X, ORG_Y, ORG_Z, TNEAR, DIR_X, DIR_Y, DIR_Z, TIME, TFAR, MASK, ID, FLAGS = range(12)
HIT = 12  # where the hit begins: its normal, three words that nothing here reads
U, V, PRIM_ID, GEOM_ID, INST_ID, INST_PRIM_ID = range(HIT + 3, HIT + 9)
WORDS = 24  # with padding
ALIGNMENT = 16  # bytes
INVALID_ID = 0xFFFFFFFF  # RTC_INVALID_GEOMETRY_ID
