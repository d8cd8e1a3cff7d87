"""Check sums of what a study keeps on the disk.

They tell that something was changed after it was written: by a disk, a cable, an editor or another program. They are
no signature: whoever wants to deceive can compute them anew.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

CHECK_SUM = "check_sum"
"""Name of the entry that holds a check sum."""
SUM_LENGTH = 16


def check_sum(*parts: bytes) -> str:
    """Return the check sum of some bytes, as 16 hexadecimal digits; a change goes unnoticed once in 2^64 times."""
    digest = hashlib.blake2b(digest_size=SUM_LENGTH // 2)
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


def sum_of_texts(texts: Mapping[str, str]) -> str:
    """Return the check sum of texts by name, whatever their order."""
    return check_sum(json.dumps(dict(texts), sort_keys=True).encode())
