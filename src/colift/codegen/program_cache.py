"""Verified cache of compiled JAX programs, in place of JAX's own cache for the folder of colift.

See Also:
    docs/decisions/0019-verify-cached-artifacts.md: the reasons.
"""

from __future__ import annotations

import contextlib
import hashlib
import secrets
from pathlib import Path

from colift.codegen import jax_internals
from colift.runtime import bounded_read, cache

DIGEST_SIZE = 32
"""Size of the digest at the begin of an entry [bytes]."""
MAX_ENTRY_BYTES = 2**30
"""Largest entry that is used [bytes]."""


class VerifiedCache:
    """Cache of compiled programs that verifies each entry before it is used; for `jax._src.compilation_cache`.

    JAX's own cache writes files in place and does not verify them. A process that is killed leaves a part of an entry,
    which causes warnings at each start, and a flipped bit can terminate the process in XLA. Here an entry begins with
    the SHA-256 digest of its key and content, and is renamed into place. An entry that does not match is removed, and
    the program is compiled again.
    """

    def __init__(self, folder: str) -> None:
        """Use a folder, which exists.

        Args:
            folder: Folder of the entries.
        """
        self._path = Path(folder)  # JAX reads this attribute

    def get(self, key: str) -> bytes | None:
        """Return the content of an entry; None if it does not exist or is damaged."""
        path = self._entry(key)
        try:
            stored = bounded_read.read_bytes(path, MAX_ENTRY_BYTES)
        except OSError:
            return None
        digest, content = stored[:DIGEST_SIZE], stored[DIGEST_SIZE:]
        if digest == _entry_digest(key, content):
            return content
        with contextlib.suppress(OSError):  # a read-only folder, or removed by another process
            path.unlink()
        return None

    def put(self, key: str, value: bytes) -> None:
        """Add an entry; without space or permission, nothing is added."""
        path = self._entry(key)
        temporary = path.with_name(f"{secrets.token_hex(8)}.new")
        try:
            temporary.write_bytes(_entry_digest(key, value) + value)
            temporary.replace(path)
        except OSError:
            with contextlib.suppress(OSError):
                temporary.unlink()

    def _entry(self, key: str) -> Path:
        """Return the file of an entry."""
        return self._path / f"{key}.program"


def _entry_digest(key: str, content: bytes) -> bytes:
    """Return the digest of an entry; the key is included, so that a renamed file does not match."""
    return hashlib.sha256(key.encode() + b"\0" + content).digest()


def install() -> None:
    """Verify the compiled programs in the cache folder of colift; without such a folder nothing is changed."""
    with contextlib.suppress(cache.CacheUnavailable):  # reported at the import of colift
        jax_internals.replace_file_cache(cache.cache_directory("jax"), VerifiedCache)
