"""The seal of a recording: a hash by which it shows whether what it says about its run was changed afterwards.

It is no signature: whoever rewrites a recording on purpose can seal it anew. It tells an edit with other tools, and the
samples remain the evidence: what they give is shown, whatever the file says.
"""

import hashlib
import json
from collections.abc import Mapping

SEAL_METADATA = "seal"
"""Metadata record with the seal under the key :data:`SEAL_KEY`."""

SEAL_KEY = "sha256"

WALL_CLOCK_PREFIX = "wall_clock"
"""Metadata records whose names begin so differ between equal runs and are not sealed: equal runs have equal seals."""


def seal_of(metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes]) -> str:
    """SHA-256, hexadecimal, over all metadata records but the seal and the wall clock's, and over all attachments.

    Hashed is the UTF-8 text of ``{"attachments": {name: sha256 of the data}, "metadata": {name: {key: value}}}`` as
    JSON with sorted keys, without blanks and without escapes of what is not ASCII.
    """
    sealed = {
        "metadata": {
            name: dict(entries) for name, entries in metadata.items()
            if name != SEAL_METADATA and not name.startswith(WALL_CLOCK_PREFIX)
        },
        "attachments": {name: hashlib.sha256(data).hexdigest() for name, data in attachments.items()},
    }  # fmt: skip
    text = json.dumps(sealed, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
